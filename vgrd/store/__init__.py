"""What survives the process: recorded sessions and calibrations.

May import the calibration and the model whose values it keeps.
"""
