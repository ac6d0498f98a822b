"""The simulated cell: its truth, and how arm and operator differ from it.

Shares no constant with the estimators.
"""
