"""Photographs of printed tags, drawn by other means than those of the fake cell and of the fit.

May import the geometry only: no code and no constant of the other drawings, none of `vgrd.vision`.
"""
