"""Equations as the paper prints them, which nobody should serve, and studies that measure what they cost.

May import the paper's studies, the simulation and the calibration.
"""
