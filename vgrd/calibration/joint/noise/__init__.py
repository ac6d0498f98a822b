"""Noise of the joint estimate: how large each kind of it is, by its own samples.

May import fit, rows and robust of the joint estimate.
"""
