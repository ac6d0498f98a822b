"""Calibration boards in pictures: their place, their true sizes.

May import images, print, alignment and tags.
"""
