"""What the verdicts rest on: each value once, with its reason."""

import numpy as np

# How much of an answer may rest on what a session left open.
IRRELEVANT_MM = 0.25  # the median touch of the paper (sigma 0.233 mm) is no better known

# Noise, mistake, contradiction: in sigmas of the sensors or of the fit.
NOISY_SCALE = 3.0  # residuals over promise: an operator twice as rough as stated passes, a loose tag does not
WRONG_SIGMA = 6.0  # residuals so large are a mistake, not noise: 3 sigma is met by chance
OUTLIER_SIGMA = 3.5  # of a touch against all others: 1 in 2,000 good ones
PICTURE_SIGMA = 4.5  # of a picture: many, and their noise is known; 1 in 150,000 good ones
HOLE_SIGMA = 5.0  # of a hole's sighting: dozens in every session
SPIN_SIGMA = 5.0  # of a spin off the common axis
SPIN_MM = 0.2  # a slip below it is the noise of a tag on a rough day
FITS_MODEL = 0.9999  # of good pictures: one in 10,000 is taken for one of something that moved
CONTRADICTS = 1 - 5e-9  # of pictures after the first ones: a third of one in a year at 2 Hz
SLIPPED = 1 - 2.5e-9  # of each of four sums of pictures: two thirds of one in a year at 2 Hz
BELIEVED_CAMERA = 0.995  # of misses in the radius where no tag A checks the camera: 99 % and room for a poor guess
CAMERA_STANDS = 0.99  # one picture in 100 of a camera that stands loses the help of its stability
PLAUSIBLE = 0.998  # of good touches, by each of two comparisons: 1 in 300 is asked about
CHANCE = 1e-3  # share of good files whose scatter is larger

# Samples that belong to no common set-up, whatever the noise.
CONTRADICTORY_DEG = 3.0  # no arm and no camera is so wrong
CONTRADICTORY_MM = 25.0  # the same for lengths: a tag's whole edge
TOUCHES_CONTRADICT_MM = 3.0  # rms of touches: thirteen times the paper's sigma
PIVOT_APART_MM = 3.0  # between two estimates of one rotation centre: the same

# Known too little to be used.
WEAK_MM = 10.0  # 1 sigma of a camera's place in a dataset
WEAK_DEG = 1.0  # 1 sigma of its orientation
WEAK_TCP_MM = 5.0  # 95 % radius of a TCP
OPEN_TCP_MM = 500.0  # sigma of a TCP along the only axis of turning: no tool is longer
UNKNOWN_MM = 1000.0  # sigma of a place of which nothing is known: larger than any cell's need

# Motion.
CENTER_MM = 0.5  # 1 sigma per axis of a turntable's centre in CAD: a guess, one that is 1 mm wrong is served
NO_ROTATION_RAD = np.radians(0.5)  # rms: a wrist that was meant to stay turned no more than this
SAME_ORIENTATION_RAD = np.radians(0.05)  # 0.1 mm at a tool of 120 mm
REACH_MM = 500.0  # from base to flange: what turns an error of the arm in mm into one in rad

# Two poses that are one: the robot was not read again. Stated noise plays no part.
SAME_POSE_MM = 1e-6  # as read: far above a double's rounding, far below what an arm moves
SAME_POSE_RAD = 1e-9  # the same at 1 m
SAME_TEXT_MM = 1e-3  # as written in a file: its last digit
SAME_TEXT_RAD = 1e-6  # the same at 1 m

# Points that lie on one line: second spread over the first.
LINE = 1e-2  # 2 mm over a plate of 200 mm: what a touch of 0.2 mm can tell with margin
HOLES_LINE = 0.02  # the centre of a circle lies farther off than the holes
PLANE_LINE = 0.05  # of tips on a plane, whose place is not known yet
