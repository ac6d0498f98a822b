"""Answers to the robot: which calibration is active, what it answers, how long that holds.

Runs beside the 250 ms deadline; may import calibration, model, registers and store.
"""
