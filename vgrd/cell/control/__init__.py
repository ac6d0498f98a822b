"""Commands of people and programs on the control socket of the cell process.

May import everything of the cell.
"""
