"""What the named methods are given: motions of the robot and of the camera side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, log_rotation, nearest_rotation

Indices = NDArray[np.intp]

_CLEAR_TURN_RAD = 3.0  # the axis of a turn near pi is lost in noise
_NO_TURN = 1e-3  # spread of unit axes below which they are one axis


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """Poses A_i and B_i: rotations (n, 3, 3) and translations (n, 3), one unit of length."""

    R_A: Array
    t_A: Array  # noqa: N815
    R_B: Array
    t_B: Array  # noqa: N815

    @classmethod
    def absolute(cls, flange_motions: Sequence[Pose], cameras: Sequence[Pose]) -> Self:
        """The poses themselves, for A X = Z B."""
        return cls(
            np.array([move.rotation for move in flange_motions]),
            np.array([move.translation for move in flange_motions]),
            np.array([camera.rotation for camera in cameras]),
            np.array([camera.translation for camera in cameras]),
        )

    @classmethod
    def between_all(cls, flange_motions: Sequence[Pose], cameras: Sequence[Pose]) -> Self:
        """Motions from every pose to every other one, both ways, for A X = X B.

        Both ways, since most methods weigh a motion and its inverse a little differently: so the
        order of the samples cannot matter. Turns near 180 degrees are left out, their axis has no
        sign. Raises NotObservable when too few are left.
        """
        poses = cls.absolute(flange_motions, cameras)
        end, start = np.nonzero(~np.eye(len(flange_motions), dtype=np.bool_))
        R_A, t_A = _difference(poses.R_A, poses.t_A, end, start)
        R_B, t_B = _difference(poses.R_B, poses.t_B, end, start)
        turns = log_rotation(R_A), log_rotation(R_B)
        clear = np.max(np.linalg.norm(turns, axis=2), axis=0) < _CLEAR_TURN_RAD
        spread = np.linalg.svd(turns[0][clear], compute_uv=False)
        if len(spread) < 3 or spread[1] < _NO_TURN:
            raise NotObservable(
                "hand-eye: nearly all motions between the samples are half turns, whose axis has "
                "no sign; add poses that turn by 20 to 90 degrees about two axes",
                rank=6,
                unknowns=12,
            )
        return cls(R_A[clear], t_A[clear], R_B[clear], t_B[clear])

    def scaled(self) -> tuple["Motions", float]:
        """The same with translations in units of their own rms size, and that size.

        Methods that solve rotation and translation at once thus give the same in mm and in m.
        """
        squares = np.concatenate([self.t_A, self.t_B]) ** 2
        size = float(np.sqrt(squares.sum(axis=1).mean())) or 1.0
        return replace(self, t_A=self.t_A / size, t_B=self.t_B / size), size


def _difference(R: Array, t: Array, end: Indices, start: Indices) -> tuple[Array, Array]:
    rotations = R[end] @ np.swapaxes(R[start], 1, 2)
    return rotations, t[end] - np.einsum("nij,nj->ni", rotations, t[start])


def mean_of(poses: Sequence[Pose]) -> Pose:
    """Chordal mean of the rotations, mean of the translations."""
    R = np.mean([pose.rotation for pose in poses], axis=0)
    return Pose(
        nearest_rotation(R, tolerance=np.inf), np.mean([p.translation for p in poses], axis=0)
    )


def rotation_from_scaled(matrix: Array) -> Array:
    """Rotation (3, 3) nearest to a matrix that is known up to a factor of either sign."""
    return nearest_rotation(matrix * np.sign(np.linalg.det(matrix)), tolerance=np.inf)


def quaternions(rotations: Array) -> Array:
    """Unit quaternions (n, 4), scalar first and not negative, of rotations (n, 3, 3)."""
    return np.asarray(Rotation.from_matrix(rotations).as_quat(canonical=True, scalar_first=True))


def rotation_of(quaternion: Array) -> Array:
    """Rotation (3, 3) of a quaternion (4,) of any length."""
    return np.asarray(Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


def pure(vectors: Array) -> Array:
    """Quaternions (n, 4) without scalar part of vectors (n, 3)."""
    return np.concatenate([np.zeros((len(vectors), 1)), vectors], axis=1)


def left(q: Array) -> Array:
    """Matrices (n, 4, 4) with `left(q) @ p == q p`, quaternions (n, 4)."""
    w, x, y, z = q.T
    rows = [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]
    return np.moveaxis(np.array(rows), 2, 0)


def right(q: Array) -> Array:
    """Matrices (n, 4, 4) with `right(q) @ p == p q`, quaternions (n, 4)."""
    w, x, y, z = q.T
    rows = [[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]]
    return np.moveaxis(np.array(rows), 2, 0)
