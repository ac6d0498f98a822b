"""What the paper does not show: coverage, mistakes, degenerate motions, coaching.

May import the studies' frame, the simulation and the calibration.
"""
