"""What moves after teaching, or while it is taught: camera, tags, object.

May import the studies' frame, the simulation and the calibration.
"""
