"""Figures and tables of the paper, and its conventional methods.

May import the studies' frame, the simulation and the calibration.
"""
