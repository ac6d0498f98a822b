"""Do robot poses and pictures of a target belong to one hand-eye pose? Closed form, outliers tolerated.

`camera_from_target_i = X^-1 M_i Y` as in `vgrd.calibration.hand_eye.pose_pairs`; rotations by Park and Martin
1994, then translations with the unit of the robot's lengths as a further unknown. Where the wrist
turned about one axis or none, the translations have a say in the rotation too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose, hat, log_rotation, nearest_rotation

_NEAR_HALF_TURN_RAD = 3.0  # the axis of a turn near pi is lost in noise
_NEIGHBOURS = 4  # pairs of each sample: linear in the samples, and no outlier spoils many
_ROUNDS = 4  # of reweighing
_LEAST_RAD = 1e-4  # keeps exact data from weights without bound
_ONE_AXIS_RAD = np.radians(1.0)  # rms about a second axis: below it the positions have a say
_FAINT = 1e-2  # weight of the positions where one axis is known
_LEAST_MM = 1e-3  # keeps exact data from weights without bound
_NO_MOTION_MM = 1e-9  # a column of zeros stays one


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """n poses as arrays: rotations (n, 3, 3), translations (n, 3) mm."""

    rotations: Array
    translations: Array

    @classmethod
    def of(cls, poses: Sequence[Pose]) -> "Poses":
        """From a list."""
        return cls(
            np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3),
            np.array([pose.translation for pose in poses]).reshape(-1, 3),
        )

    def __len__(self) -> int:
        return len(self.rotations)

    def inverted(self) -> "Poses":
        """Every pose inverted."""
        R = np.swapaxes(self.rotations, 1, 2)
        return Poses(R, -np.einsum("nij,nj->ni", R, self.translations))

    def listed(self) -> list[Pose]:
        """The poses one by one."""
        return [Pose(R, t) for R, t in zip(self.rotations, self.translations, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well the samples agree, medians; X, Y: the poses that they agree on.

    millimetres: what one unit of the robot's lengths measures by the size of the target, 1 where
    it was not asked for.
    """

    deg: float
    mm: float
    millimetres: float
    X: Pose
    Y: Pose

    def within(self, deg: float, mm: float) -> bool:
        """Whether both medians are below limits."""
        return self.deg <= deg and self.mm <= mm


def agreement(flange_motions: Poses, cameras: Poses, *, unit_known: bool = False) -> Agreement:
    """Fit of all samples; at least three are needed for it to mean anything."""
    R_X, R_Y, deg = _rotations(flange_motions, cameras)
    t_X, t_Y, unit, mm = _translations(flange_motions, cameras, R_X, unit_known=unit_known)
    return Agreement(deg, mm, unit, Pose(R_X, t_X), Pose(R_Y, t_Y))


def _rotations(flange_motions: Poses, cameras: Poses) -> tuple[Array, Array, float]:
    """R_X, R_Y and the median misfit, degrees, of `M R_Y = R_X C`."""
    M, C, n = flange_motions.rotations, cameras.rotations, len(flange_motions)
    steps = range(1, min(_NEIGHBOURS, n - 1) + 1)
    first = np.concatenate([np.arange(n) for _ in steps])
    second = np.concatenate([np.roll(np.arange(n), -k) for k in steps])
    alpha = log_rotation(M[first] @ np.swapaxes(M[second], 1, 2))
    beta = log_rotation(C[first] @ np.swapaxes(C[second], 1, 2))
    weights = (np.linalg.norm(alpha, axis=1) < _NEAR_HALF_TURN_RAD).astype(float)
    weights *= np.linalg.norm(beta, axis=1) < _NEAR_HALF_TURN_RAD
    stable = weights
    spread = np.linalg.svd(beta * stable[:, None], compute_uv=False) / np.sqrt(len(beta))
    place_term = np.zeros((3, 3))
    if spread[1] < _ONE_AXIS_RAD:
        share = _FAINT if spread[0] > _ONE_AXIS_RAD else 1 / _FAINT
        turn = from_positions(flange_motions.translations, cameras)[0]
        place_term = share * (spread[0] + _LEAST_RAD) ** 2 * turn
    for _ in range(_ROUNDS):
        R_X = nearest((alpha * weights[:, None]).T @ beta / len(beta) + place_term)
        residuals = np.linalg.norm(alpha - beta @ R_X.T, axis=1)
        typical = max(float(np.median(residuals)), _LEAST_RAD)
        weights = stable / (1 + (residuals / typical) ** 2)
    rotations = np.swapaxes(M, 1, 2) @ R_X @ C
    R_Y = nearest(rotations.sum(axis=0))
    for _ in range(_ROUNDS):
        residuals = np.linalg.norm(log_rotation(rotations @ R_Y.T), axis=1)
        typical = max(float(np.median(residuals)), _LEAST_RAD)
        R_Y = nearest((rotations / (1 + (residuals / typical) ** 2)[:, None, None]).sum(axis=0))
    return R_X, R_Y, float(np.degrees(np.median(residuals)))


def _translations(
    flange_motions: Poses, cameras: Poses, R_X: Array, *, unit_known: bool
) -> tuple[Array, Array, float, float]:
    """t_X, t_Y, unit and the median misfit, mm, of `unit t_M + R_M t_Y - t_X = R_X t_C`."""
    n = len(flange_motions)
    rows = np.concatenate(
        [
            flange_motions.rotations,
            np.broadcast_to(-np.eye(3), (n, 3, 3)),
            np.zeros((n, 3, 0)) if unit_known else flange_motions.translations[:, :, None],
        ],
        axis=2,
    )
    right = cameras.translations @ R_X.T - (flange_motions.translations if unit_known else 0.0)
    weights = np.ones(n)
    for _ in range(_ROUNDS):
        A = (rows * weights[:, None, None]).reshape(3 * n, -1)
        size = np.maximum(np.linalg.norm(A, axis=0), _NO_MOTION_MM)
        x = np.linalg.lstsq(A / size, (right * weights[:, None]).ravel(), rcond=1e-9)[0] / size
        residuals = np.linalg.norm(rows @ x - right, axis=1)
        typical = max(float(np.median(residuals)), _LEAST_MM)
        weights = 1 / np.sqrt(1 + (residuals / typical) ** 2)
    unit = 1.0 if unit_known else float(x[6])
    return x[3:6], x[:3], unit, float(np.median(residuals))


def nearest(matrix: Array) -> Array:
    """Proper rotation (3, 3) nearest to any matrix."""
    return nearest_rotation(matrix, tolerance=np.inf)


def from_positions(places: Array, cameras: Poses) -> tuple[Array, Array, float]:
    """R_X, the flange's place in the target (3,) mm and the median misfit, from flange positions alone.

    `places_i = R_X (t_Ci + R_Ci q) + t_X`: no rotation of the robot is used.
    """
    q, R_X, t_X = np.zeros(3), np.eye(3), np.zeros(3)
    for _ in range(60):
        points = cameras.translations + cameras.rotations @ q
        R_X = nearest((places - places.mean(axis=0)).T @ (points - points.mean(axis=0)))
        rows = np.concatenate(
            [cameras.rotations, np.broadcast_to(R_X.T, cameras.rotations.shape)], axis=2
        )
        right = places @ R_X - cameras.translations
        x = np.linalg.lstsq(rows.reshape(-1, 6), right.ravel(), rcond=1e-9)[0]
        step, q, t_X = float(np.linalg.norm(x[:3] - q)), x[:3], x[3:]
        if step < _LEAST_MM:
            break
    misses = places - (cameras.translations + cameras.rotations @ q) @ R_X.T - t_X
    return R_X, q, float(np.median(np.linalg.norm(misses, axis=1)))


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """What one camera pose of the samples is worth, per axis, the robot's error included."""

    mm: float
    rad: float


def noise_of(
    cameras: Poses, covariances: Array, robot_sigma_mm: float, robot_sigma_rad: float
) -> PoseNoise:
    """Median noise of the target's pose; covariances (n, 6, 6), left tangents."""
    place = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(cameras), 3, 3)), -hat(cameras.translations)], axis=2
    )
    target_covariances = place @ covariances @ np.swapaxes(place, 1, 2)
    mm = np.sqrt(np.trace(target_covariances, axis1=1, axis2=2) / 3)
    rad = np.sqrt(np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2) / 3)
    return PoseNoise(
        float(np.hypot(np.median(mm), robot_sigma_mm)),
        float(np.hypot(np.median(rad), robot_sigma_rad)),
    )
