"""Hand-eye calibration from pairs of poses or from points, certified.

May import observability; `published` holds the methods of others, unrefined.
"""

from vgrd.calibration.hand_eye.features import FeaturePlace
from vgrd.calibration.hand_eye.fit import PoseSample
from vgrd.calibration.hand_eye.null_space import null_space_findings, undetermined_in_words
from vgrd.calibration.hand_eye.park_martin import park_martin_start
from vgrd.calibration.hand_eye.pose_pairs import (
    HandEyeProblem,
    HandEyeResult,
    SampleResidual,
    calibrate_hand_eye,
)
from vgrd.calibration.hand_eye.published import METHODS, PosePair
from vgrd.calibration.hand_eye.recording import calibrate_recording, demands_refinement
from vgrd.calibration.hand_eye.recording_problem import (
    PointSample,
    RecordingProblem,
    points_problem,
    poses_problem,
)
from vgrd.calibration.hand_eye.samples import first_of_same, hand_eye_samples, sightings_of_tag_a
from vgrd.calibration.hand_eye.state import flange_motion_of

__all__ = [
    "METHODS",
    "FeaturePlace",
    "HandEyeProblem",
    "HandEyeResult",
    "PointSample",
    "PosePair",
    "PoseSample",
    "RecordingProblem",
    "SampleResidual",
    "calibrate_hand_eye",
    "calibrate_recording",
    "demands_refinement",
    "first_of_same",
    "flange_motion_of",
    "hand_eye_samples",
    "null_space_findings",
    "park_martin_start",
    "points_problem",
    "poses_problem",
    "sightings_of_tag_a",
    "undetermined_in_words",
]
