"""Commands that look whether a cell is as it should be: its file, its drivers, its devices, its picture.

May import what all commands may.
"""
