"""Answers to the robot: which calibration is active, what it answers, how long that holds.

Runs beside the 250 ms deadline; may import calibration, model, registers, store, and of
solving what tells whether a calibration can serve.
"""
