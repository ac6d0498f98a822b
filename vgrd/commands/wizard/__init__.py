"""Teaching in a terminal: one next step, one key.

May import what all commands may.
"""
