"""Rigid motions: `Pose`, an immutable element of SE(3).

Tangent vectors are (v, w), translation first; perturbations act on the left (paper, Eq. 12-14).
Lengths are millimetres and angles radians throughout the package.
"""

import math
from dataclasses import dataclass
from typing import Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vgrd.errors import InputError

Array = NDArray[np.float64]
Row = tuple[float, float, float]

_SMALL_ANGLE = 1e-2  # below, series: their first neglected term is under 1e-16
_SMALL_ANGLE_FIFTH_ORDER = 0.1  # idem; the closed form cancels six digits there
_ORTHONORMAL_TOLERANCE = 1e-6  # of a row's products: 0.001 mm at a distance of 1 m
_TINY_SINE = 1e-9  # below, atan2(s, w) / s is 1 / w to 1e-18
_LAST_ROW_TOLERANCE = 1e-9  # of 0 0 0 1, which no file rounds


def hat(vector: Array) -> Array:
    """Cross-product matrices, shape (..., 3) -> (..., 3, 3): `hat(a) @ b == cross(a, b)`."""
    v = np.asarray(vector, dtype=np.float64)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1] = v[..., 0]
    out[..., 0, 2] = v[..., 1]
    out[..., 1, 0] = v[..., 2]
    return out - np.swapaxes(out, -1, -2)


def _coefficients(angle: float) -> tuple[float, float, float, float]:
    """(sin a / a, (1 - cos a) / a^2, (a - sin a) / a^3, (a^2/2 - 1 + cos a) / a^4), by series near zero.

    The closed forms cancel digits near zero: (a - sin a) / a^3 loses five of them at 1e-2. The series takes
    over there, where its first neglected term is below 1e-16.
    """
    s = angle * angle
    if angle < _SMALL_ANGLE:
        return (
            1 - s / 6 * (1 - s / 20 * (1 - s / 42)),
            0.5 - s / 24 * (1 - s / 30 * (1 - s / 56)),
            1 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72)),
            1 / 24 - s / 720 * (1 - s / 56 * (1 - s / 90)),
        )
    sine = np.sin(angle)
    versine = 2 * np.sin(angle / 2) ** 2
    return (
        sine / angle,
        versine / s,
        (angle - sine) / (s * angle),
        (s / 2 - versine) / (s * s),
    )


def exp_rotation(rotvec: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues)."""
    w = np.asarray(rotvec, dtype=np.float64)
    sinc, half, _, _ = _coefficients(float(np.linalg.norm(w)))
    W = hat(w)
    return np.eye(3) + sinc * W + half * (W @ W)


def log_rotation(rotation: ArrayLike) -> Array:
    """Rotation vectors (..., 3), radians in [0, pi], of rotation matrices (..., 3, 3).

    Through the quaternion with the largest component first (Shepperd 1978), which is accurate for
    the smallest turns and for half turns.
    """
    R = np.asarray(rotation, dtype=np.float64)
    if R.ndim > 2:
        return _log_rotations(R.reshape(-1, 3, 3)).reshape(R.shape[:-1])
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = squares.index(max(squares))
    w, x, y, z = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[largest]
    sine = math.sqrt(x * x + y * y + z * z)
    if w < 0:
        w, sine = -w, -sine
    scale = 2 / w if abs(sine) < _TINY_SINE * w else 2 * math.atan2(abs(sine), w) / sine
    return np.array([scale * x, scale * y, scale * z])


def _log_rotations(R: Array) -> Array:
    """The same of (n, 3, 3): row k of the 4 x 4 is the quaternion (scalar first) times 4 times its number k."""
    (a, b, c), (d, e, f), (g, h, i) = R.transpose(1, 2, 0)
    w, x, y, z = 1 + a + e + i, h - f, c - g, d - b
    if (w < 1).any():
        rows = (
            (w, x, y, z),
            (x, 1 + a - e - i, b + d, c + g),
            (y, b + d, 1 - a + e - i, f + h),
            (z, c + g, f + h, 1 - a - e + i),
        )
        every = np.array(rows)
        largest = np.argmax(every[range(4), range(4)], axis=0)
        w, x, y, z = every[largest, :, np.arange(len(R))].T
    sine = np.copysign(np.sqrt(x * x + y * y + z * z), w)
    w = np.abs(w)
    is_tiny = np.abs(sine) < _TINY_SINE * w
    angle = 2 * np.arctan2(np.abs(sine), w)
    scale = np.where(
        is_tiny, np.copysign(2 / np.maximum(w, 1), sine), angle / np.where(is_tiny, 1, sine)
    )
    return np.asarray(scale[:, None] * np.column_stack([x, y, z]))


def _is_rotation(x: Row, y: Row, z: Row) -> bool:
    """Whether rows are orthonormal and right-handed; plain numbers, which are faster than so small arrays."""
    (a, b, c), (d, e, f), (g, h, i) = x, y, z
    off = max(
        abs(a * a + b * b + c * c - 1),
        abs(d * d + e * e + f * f - 1),
        abs(g * g + h * h + i * i - 1),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return off <= _ORTHONORMAL_TOLERANCE and determinant >= 0


def left_jacobian_rotation(rotvec: ArrayLike) -> Array:
    """Left Jacobian (3, 3) of SO(3) at a rotation vector (3,)."""
    w = np.asarray(rotvec, dtype=np.float64)
    _, half, third, _ = _coefficients(float(np.linalg.norm(w)))
    W = hat(w)
    return np.eye(3) + half * W + third * (W @ W)


def _left_jacobian_coupling(v: Array, w: Array) -> Array:
    """Translation-rotation block Q (3, 3) of the left Jacobian of SE(3) (Barfoot 2017, Eq. 7.86)."""
    angle = float(np.linalg.norm(w))
    _, _, third, fourth = _coefficients(angle)
    s = angle * angle
    fifth = (
        1 / 120 - s / 2520 * (1 - s / 48 * (1 - s / 82.5))
        if angle < _SMALL_ANGLE_FIFTH_ORDER
        else (2 * angle - 3 * np.sin(angle) + angle * np.cos(angle)) / (2 * angle**5)
    )
    V, W = hat(v), hat(w)
    WV, VW, WVW = W @ V, V @ W, W @ V @ W
    return (
        0.5 * V
        + third * (WV + VW + WVW)
        + fourth * (W @ WV + VW @ W - 3 * WVW)
        + fifth * (WVW @ W + W @ WVW)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """`target_from_source`: maps points of the source frame to the target frame.

    rotation: (3, 3) proper orthonormal; translation: (3,) mm. Both arrays are copied and frozen.
    Raises InputError on anything that is not a finite rigid motion.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        R = np.array(self.rotation, dtype=np.float64)
        t = np.array(self.translation, dtype=np.float64)
        if R.shape != (3, 3) or t.shape != (3,):
            raise InputError(f"a pose needs shapes (3, 3) and (3,), got {R.shape} and {t.shape}")
        rows, place = R.tolist(), t.tolist()
        if not all(map(math.isfinite, (*rows[0], *rows[1], *rows[2], *place))):
            raise InputError("a pose must be finite")
        if not _is_rotation(*rows):
            raise InputError("not a rotation matrix: rows must be orthonormal with determinant +1")
        R.setflags(write=False)
        t.setflags(write=False)
        object.__setattr__(self, "rotation", R)
        object.__setattr__(self, "translation", t)

    @classmethod
    def identity(cls) -> Self:
        """The motion that does nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """From a homogeneous matrix (4, 4); its rotation is projected onto SO(3) if within 1e-3 of it."""
        M = np.asarray(matrix, dtype=np.float64)
        if M.shape != (4, 4) or not np.isfinite(M).all():
            raise InputError(f"a homogeneous matrix is finite and (4, 4), got shape {M.shape}")
        if np.abs(M[3] - (0, 0, 0, 1)).max() > _LAST_ROW_TOLERANCE:
            raise InputError("the last row of a homogeneous matrix is 0 0 0 1")
        return cls(nearest_rotation(M[:3, :3]), M[:3, 3])

    @classmethod
    def from_rotvec(cls, rotvec: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Self:
        """From a rotation vector (3,) in radians and a translation (3,) in mm."""
        return cls(exp_rotation(rotvec), np.asarray(translation, dtype=np.float64))

    @classmethod
    def exp(cls, tangent: ArrayLike) -> Self:
        """Exponential of a tangent vector (6,): (v, w), mm and rad."""
        xi = np.asarray(tangent, dtype=np.float64)
        return cls(exp_rotation(xi[3:]), left_jacobian_rotation(xi[3:]) @ xi[:3])

    def log(self) -> Array:
        """Tangent vector (6,): the inverse of `exp`."""
        w = log_rotation(self.rotation)
        return np.concatenate([np.linalg.solve(left_jacobian_rotation(w), self.translation), w])

    def inverse(self) -> "Pose":
        """`source_from_target`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def matrix(self) -> Array:
        """Homogeneous matrix (4, 4)."""
        M = np.eye(4)
        M[:3, :3] = self.rotation
        M[:3, 3] = self.translation
        return M

    def adjoint(self) -> Array:
        """Adjoint (6, 6): `T exp(xi) T^-1 == exp(T.adjoint() @ xi)`."""
        A = np.zeros((6, 6))
        A[:3, :3] = A[3:, 3:] = self.rotation
        A[:3, 3:] = hat(self.translation) @ self.rotation
        return A

    @staticmethod
    def left_jacobian(tangent: ArrayLike) -> Array:
        """Left Jacobian (6, 6): `exp(xi + d) ~ exp(left_jacobian(xi) @ d) exp(xi)`."""
        xi = np.asarray(tangent, dtype=np.float64)
        J = np.zeros((6, 6))
        J[:3, :3] = J[3:, 3:] = left_jacobian_rotation(xi[3:])
        J[:3, 3:] = _left_jacobian_coupling(xi[:3], xi[3:])
        return J

    def compose(self, other: "Pose") -> "Pose":
        """`a_from_b.compose(b_from_c)` is `a_from_c`."""
        return Pose(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of the source frame, in the target frame; mm."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    @overload
    def __matmul__(self, other: "Pose") -> "Pose": ...

    @overload
    def __matmul__(self, other: ArrayLike) -> Array: ...

    def __matmul__(self, other: "Pose | ArrayLike") -> "Pose | Array":
        """`pose @ pose` composes, `pose @ points` applies."""
        return self.compose(other) if isinstance(other, Pose) else self.apply(other)

    def rotvec(self) -> Array:
        """Rotation vector (3,) in radians."""
        return log_rotation(self.rotation)

    def distance(self, other: "Pose") -> tuple[float, float]:
        """(mm between the origins, rad between the orientations)."""
        return (
            float(np.linalg.norm(self.translation - other.translation)),
            float(np.linalg.norm(log_rotation(self.rotation.T @ other.rotation))),
        )


def nearest_rotation(
    matrix: ArrayLike,
    *,
    tolerance: float = 1e-3,  # numbers with three decimals are off by 5e-4
) -> Array:
    """Proper rotation (3, 3) nearest to `matrix` in the Frobenius norm; InputError when farther than `tolerance`."""
    M = np.asarray(matrix, dtype=np.float64)
    U, _, Vt = np.linalg.svd(M)
    R: Array = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    if not np.abs(R - M).max() <= tolerance:
        raise InputError(
            "not a rotation matrix: rows must be orthonormal with determinant +1 "
            f"(off by {np.abs(R - M).max():.2g})"
        )
    return R
