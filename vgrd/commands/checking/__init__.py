"""Commands that look whether a cell is as it should be: its file, devices, picture, calibrations.

May import what all commands may.
"""
