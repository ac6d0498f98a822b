"""Rotation formats of robot brands: numbers on a pendant or in a file <-> rotation matrix.

Sources: pose formats of the Basler rc_cube documentation, UR script manual; the check values of
the tests are one orientation in all formats. "fixed-xyz" turns about the axes of the base.
"""

import warnings
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry.pose import Array, Pose

_UNIT_TOLERANCE = 1e-3  # of a quaternion's length: numbers with four decimals are off by 1e-4

TURN_RAD = 2 * np.pi
_HALF_TURN_RAD = np.radians(5)  # far more than touches tell a wrist's orientation by
_LEADING = 0.3  # below it a component may be noise; one of three is at least 0.57

_Axes = Literal["xyz", "XYZ", "ZYX", "ZYZ"]


class RotationFormat(StrEnum):
    """How a device or a file writes an orientation, numbers in the order of the name."""

    ROTVEC = "rotvec"
    ROTVEC_DEG = "rotvec-deg"
    RPY_FIXED_XYZ = "rpy-fixed-xyz"
    RPY_FIXED_XYZ_DEG = "rpy-fixed-xyz-deg"
    KUKA_ABC_DEG = "kuka-abc-deg"
    ZYZ_DEG = "zyz-deg"
    FANUC_WPR_DEG = "fanuc-wpr-deg"
    YASKAWA_RXRYRZ_DEG = "yaskawa-rxryrz-deg"
    EPSON_UVW_DEG = "epson-uvw-deg"
    STAUBLI_RXRYRZ_DEG = "staubli-rxryrz-deg"
    KAWASAKI_OAT_DEG = "kawasaki-oat-deg"
    ABB_QUATERNION_WXYZ = "abb-quaternion-wxyz"
    QUATERNION_WXYZ = "quaternion-wxyz"
    QUATERNION_XYZW = "quaternion-xyzw"


# scipy's letters: lower case turns about fixed axes, upper case about the axes already turned.
_EULER: Mapping[RotationFormat, tuple[_Axes, bool]] = MappingProxyType(
    {
        RotationFormat.RPY_FIXED_XYZ: ("xyz", False),
        RotationFormat.RPY_FIXED_XYZ_DEG: ("xyz", True),
        RotationFormat.FANUC_WPR_DEG: ("xyz", True),
        RotationFormat.YASKAWA_RXRYRZ_DEG: ("xyz", True),
        RotationFormat.KUKA_ABC_DEG: ("ZYX", True),
        RotationFormat.EPSON_UVW_DEG: ("ZYX", True),
        RotationFormat.STAUBLI_RXRYRZ_DEG: ("XYZ", True),
        RotationFormat.ZYZ_DEG: ("ZYZ", True),
        RotationFormat.KAWASAKI_OAT_DEG: ("ZYZ", True),
    }
)
_SCALAR_FIRST: Mapping[RotationFormat, bool] = MappingProxyType(
    {
        RotationFormat.ABB_QUATERNION_WXYZ: True,
        RotationFormat.QUATERNION_WXYZ: True,
        RotationFormat.QUATERNION_XYZW: False,
    }
)
_LENGTH_MM: Mapping[str, float] = MappingProxyType({"mm": 1.0, "m": 1000.0})  # by definition


def value_count(fmt: RotationFormat) -> int:
    """How many numbers the format has: 4 for quaternions, else 3."""
    return 4 if fmt in _SCALAR_FIRST else 3


def _checked(values: ArrayLike, fmt: RotationFormat) -> Array:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"rotation {values!r} is not a list of numbers") from error
    if array.shape != (value_count(fmt),):
        raise InputError(
            f"rotation format {fmt} has {value_count(fmt)} numbers, got shape {array.shape}"
        )
    if not np.isfinite(array).all():
        raise InputError(f"rotation {array.tolist()} is not finite")
    return array


def rotation_from(values: ArrayLike, fmt: RotationFormat) -> Array:
    """Rotation matrix (3, 3) of `values` in the format.

    Raises InputError on a wrong count, NaN and a quaternion whose length is off by more than 1e-3.
    """
    array = _checked(values, fmt)
    if fmt in _EULER:
        axes, degrees = _EULER[fmt]
        return Rotation.from_euler(axes, array, degrees=degrees).as_matrix()
    if fmt in _SCALAR_FIRST:
        norm = float(np.linalg.norm(array))
        if abs(norm - 1) > _UNIT_TOLERANCE:
            raise InputError(
                f"quaternion {array.tolist()} has length {norm:.4f} instead of 1: "
                "wrong order, wrong columns or truncated digits"
            )
        return Rotation.from_quat(array, scalar_first=_SCALAR_FIRST[fmt]).as_matrix()
    return Rotation.from_rotvec(array, degrees=fmt is RotationFormat.ROTVEC_DEG).as_matrix()


def rotation_to(rotation: ArrayLike, fmt: RotationFormat) -> Array:
    """Numbers of the format, shape (value_count,), of a rotation matrix (3, 3).

    Where an Euler format is singular the last angle is 0; a quaternion's scalar is not negative.
    """
    matrix = Rotation.from_matrix(np.asarray(rotation, dtype=np.float64))
    if fmt in _EULER:
        axes, degrees = _EULER[fmt]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            return matrix.as_euler(axes, degrees=degrees)
    if fmt in _SCALAR_FIRST:
        return matrix.as_quat(canonical=True, scalar_first=_SCALAR_FIRST[fmt])
    return matrix.as_rotvec(degrees=fmt is RotationFormat.ROTVEC_DEG)


def rotvec_near(rotation: ArrayLike, near: ArrayLike) -> Array:
    """Rotation vector (3,), rad, of a rotation matrix (3, 3): of all that mean it, the nearest to `near` (3,).

    Turns about one axis that differ by whole turns are one orientation. So a wrist that stands by half a turn
    has a vector on either side, and noise would choose; near a fixed vector nothing jumps but half a turn from it.
    """
    shortest = Rotation.from_matrix(np.asarray(rotation, dtype=np.float64)).as_rotvec()
    angle = float(np.linalg.norm(shortest))
    if angle == 0.0:
        return shortest
    axis, wanted = shortest / angle, np.asarray(near, dtype=np.float64)
    turns = round((float(axis @ wanted) - angle) / TURN_RAD)
    return np.asarray((angle + turns * TURN_RAD) * axis)


def usual_rotvec(rotation: ArrayLike) -> Array:
    """Rotation vector (3,), rad, of a rotation matrix (3, 3), with one sign wherever a wrist stands by half a turn.

    There its first component that is not small is positive: of wrists that differ by noise, none is on the
    other side.
    """
    shortest = Rotation.from_matrix(np.asarray(rotation, dtype=np.float64)).as_rotvec()
    angle = float(np.linalg.norm(shortest))
    if angle < np.pi - _HALF_TURN_RAD:
        return shortest
    axis = shortest / angle
    leading = axis[np.flatnonzero(np.abs(axis) > _LEADING)[0]]
    return rotvec_near(rotation, np.copysign(np.pi, leading) * axis)


def pose_from(values: ArrayLike, fmt: RotationFormat, length_unit: str) -> Pose:
    """Pose of x, y, z in `length_unit` ("mm" or "m") followed by the numbers of the rotation."""
    if length_unit not in _LENGTH_MM:
        raise InputError(f"length unit {length_unit!r} is unknown: use one of {list(_LENGTH_MM)}")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"pose {values!r} is not a list of numbers") from error
    if array.shape != (3 + value_count(fmt),):
        raise InputError(
            f"a pose with rotation {fmt} has {3 + value_count(fmt)} numbers, "
            f"got shape {array.shape}"
        )
    return Pose(rotation_from(array[3:], fmt), array[:3] * _LENGTH_MM[length_unit])
