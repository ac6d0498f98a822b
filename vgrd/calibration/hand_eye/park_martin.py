"""Closed-form hand-eye start where a few bad samples must not matter: Park and Martin 1994."""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.hand_eye.published.motions import Motions
from vgrd.calibration.hand_eye.published.separable import park_martin
from vgrd.geometry import Pose, nearest_rotation


def park_martin_start(
    flange_motions: Sequence[Pose], cameras: Sequence[Pose]
) -> tuple[Pose, Pose]:
    """(X, Y) with `cameras[i] ~ X^-1 moves[i] Y`, Y from the median of the places.

    Raises NotObservable when nearly all turns are half turns.
    """
    X = park_martin(Motions.between_all(flange_motions, cameras))
    targets = [
        move.inverse() @ X @ camera for move, camera in zip(flange_motions, cameras, strict=True)
    ]
    R_Y = nearest_rotation(np.mean([pose.rotation for pose in targets], axis=0), tolerance=np.inf)
    return X, Pose(R_Y, np.median([pose.translation for pose in targets], axis=0))
