"""Pictures in, points and poses out: the only core user of OpenCV.

May import devices, model and geometry.
"""
