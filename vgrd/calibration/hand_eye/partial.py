"""Hand-eye of robots that do not turn about two axes: 4-axis arms (SCARA, delta) and portals.

The camera's rotation then comes from the translations; what stays open is a translation of the
camera and of the target together along the axis (4-axis), or in every direction (no turn at all).
"""

from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.hand_eye.null_space import free_findings
from vgrd.calibration.hand_eye.pose_pairs import HandEyeProblem, HandEyeResult, calibrate_hand_eye
from vgrd.errors import NotObservable
from vgrd.geometry import Pose
from vgrd.model import Finding

_ALL = 3


@dataclass(frozen=True, slots=True, eq=False)
class PartialHandEye:
    """What is determined, and in words what is not and how to learn it (no findings: everything is).

    result: as of `calibrate_hand_eye`; `result.free` (k, 6), k = 0, 1 or 3, is what stays open.
    """

    result: HandEyeResult
    findings: tuple[Finding, ...]

    def shifted(self, target_along_axis_mm: float) -> tuple[Pose, Pose]:
        """mount_from_camera and mount_from_target when the target's place along the axis is known.

        mm along the axis that the finding names. Raises NotObservable unless one direction is free.
        """
        free = self.result.free
        if len(free) != 1:
            raise NotObservable(
                f"hand-eye: {len(free)} directions are free, one height decides exactly one",
                rank=12 - len(free),
                unknowns=12,
            )
        shift = free[0] * np.sqrt(2) * target_along_axis_mm
        X, Y = self.result.mount_from_camera, self.result.mount_from_target
        return (
            Pose(X.rotation, X.translation + shift[:3]),
            Pose(Y.rotation, Y.translation + shift[3:]),
        )


def calibrate_hand_eye_partial(problem: HandEyeProblem) -> PartialHandEye:
    """Maximum likelihood of all that the motion determines; `may_be_free` of the problem is all.

    Raises TooFewObservations, NotObservable (rotation of the camera open; names the missing
    motion), InputError (one pose twice) or DidNotConverge.
    """
    result = calibrate_hand_eye(replace(problem, may_be_free=_ALL))
    return PartialHandEye(result, free_findings(problem.mount, result.free))
