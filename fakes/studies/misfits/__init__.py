"""Cells that are not what their file says: what is served from them, and whether they are told by name.

May import the studies' frame, the simulation and the calibration.
"""
