"""Figure 3: the TCP by a fixed point, a plane and a ball, as fits and as whole sessions.

May import the studies' frame, the simulation and the calibration.
"""
