"""What the demo shows and reports.

May import cell.
"""
