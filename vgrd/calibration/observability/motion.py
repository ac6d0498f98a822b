"""What a set of robot poses can tell, and in words which motion is missing."""

from collections.abc import Sequence
from enum import Enum

import numpy as np

from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, log_rotation
from vgrd.geometry.coincidence import equal_poses
from vgrd.geometry.covariance import Observability, observability
from vgrd.judging.thresholds import NO_ROTATION_RAD, SAME_POSE_MM, SAME_POSE_RAD

_HAND_EYE_TOLERANCE = 5e-3  # mm per mm of lever and pose: what turns of 0.5 degrees just pass
_MIN_LEVER_MM = 50.0  # poses nearer together are judged as if they were that far apart


class Axes(Enum):
    """About how many axes a set of orientations differs."""

    NONE = 0
    ONE = 1
    MANY = 2


def turned_axes(rotations: Sequence[Array]) -> tuple[Axes, Array]:
    """How many axes, and the main axis (3,), in the target frame of the rotations (3, 3)."""
    turns = np.array([log_rotation(R @ rotations[0].T) for R in rotations])
    _, s, Vt = np.linalg.svd(turns, full_matrices=False)
    spread = s / np.sqrt(len(rotations))
    count = Axes(min(int(np.sum(spread > NO_ROTATION_RAD)), 2))
    return count, Vt[0]


def check_distinct(names: Sequence[str], poses: Sequence[Pose]) -> None:
    """Raise InputError naming samples with exactly the same pose, NotObservable when all are."""
    for i, (name, same) in enumerate(
        zip(names, equal_poses(poses, SAME_POSE_MM, SAME_POSE_RAD), strict=True)
    ):
        if same.all() and len(poses) > 1:
            raise NotObservable(
                f"all {len(poses)} robot poses are equal: the robot did not move, or its pose was "
                "not read again; move the robot between the samples",
                rank=0,
                unknowns=6,
            )
        later = [names[j] for j in range(i + 1, len(names)) if same[j]]
        if later:
            raise InputError(
                f"samples {name!r} and {later[0]!r} hold the same robot pose: it was recorded "
                "twice or not read again; remove one of them"
            )


def hand_eye_observability(poses: Sequence[Pose]) -> Observability:
    """What the wrist poses determine of the 12 unknowns of a hand-eye calibration.

    Rows [-I, Ad(W_1^-1 W_i)]; undetermined: (k, 12), translation first, rotations in units that
    make them as large as translations. Raises TooFewObservations.
    """
    if len(poses) < 3:
        raise TooFewObservations(
            f"hand-eye needs at least 3 robot poses that differ in rotation, got {len(poses)}"
        )
    flange_motions = [poses[0].inverse() @ pose for pose in poses]
    lever = max(
        float(np.std([move.translation for move in flange_motions], axis=0).max()), _MIN_LEVER_MM
    )
    unit = np.array([1, 1, 1, 1 / lever, 1 / lever, 1 / lever])
    rows = [
        np.hstack([-np.eye(6), move.adjoint()]) / unit[:, None] / lever for move in flange_motions
    ]
    return observability(np.vstack(rows), np.tile(unit, 2) * lever, _HAND_EYE_TOLERANCE)


def check_hand_eye_motion(poses: Sequence[Pose]) -> None:
    """Raise unless the wrist poses determine all 12 unknowns of a hand-eye calibration."""
    rank = hand_eye_observability(poses).rank
    if rank < 12:
        raise NotObservable(
            f"hand-eye: the robot poses determine {rank} of 12 unknowns: "
            + missing_rotation([pose.rotation for pose in poses]),
            rank=rank,
            unknowns=12,
        )


def missing_rotation(rotations: Sequence[Array]) -> str:
    """Say in words which rotation of the wrist is missing."""
    count, axis = turned_axes(rotations)
    if count is Axes.NONE:
        return "the wrist kept its orientation; turn it by 20 degrees or more about two axes"
    x, y, z = axis
    return (
        f"the wrist turned about one axis only, ({x:.2f}, {y:.2f}, {z:.2f}) of the base; "
        "turn it by 20 degrees or more about another axis too"
    )
