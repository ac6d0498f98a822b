"""Poses as files hold them: the numbers of a robot, or matrices row by row or column by column."""

from collections.abc import Sequence

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry.pose import Array, Pose
from vgrd.geometry.rotation_formats import RotationFormat, pose_from, rotation_to

MATRIX = "matrix"
MATRIX_COLUMNS = "matrix-columns"
POSE_FORMATS = (*RotationFormat, MATRIX, MATRIX_COLUMNS)
MM_PER = {"mm": 1.0, "m": 1000.0}  # by definition
_ROWS, _NUMBERS = 12, 16  # of a matrix without and with its last row
_LAST = np.array([0.0, 0.0, 0.0, 1.0])
_SAME = 1e-6  # rounding of a text, as `Pose.from_matrix`


def written_pose(values: Sequence[float], fmt: str, unit: str) -> Pose:
    """The pose, mm, of numbers in one of POSE_FORMATS; InputError names what does not fit."""
    if fmt not in (MATRIX, MATRIX_COLUMNS):
        return pose_from(values, RotationFormat(fmt), unit)
    matrix = _matrix(values, fmt)
    matrix[:3, 3] *= MM_PER[unit]
    return Pose.from_matrix(matrix)


def robot_numbers(
    values: Sequence[float], pose: Pose, fmt: str, unit: str
) -> tuple[tuple[float, ...], RotationFormat]:
    """The numbers as a robot would write them, for the search of a wrong convention."""
    if fmt not in (MATRIX, MATRIX_COLUMNS):
        return tuple(values), RotationFormat(fmt)
    rotation = RotationFormat.QUATERNION_XYZW
    numbers = [*pose.translation / MM_PER[unit], *rotation_to(pose.rotation, rotation)]
    return tuple(float(number) for number in numbers), rotation


def mm_and_degrees(pose: Pose) -> dict[str, list[float]]:
    """A pose as people read it: position_mm and rotvec_deg, to 0.001."""
    numbers = {"position_mm": pose.translation, "rotvec_deg": np.degrees(pose.rotvec())}
    return {name: (values.round(3) + 0.0).tolist() for name, values in numbers.items()}  # no -0.0


def _matrix(values: Sequence[float], fmt: str) -> Array:
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.size not in (_ROWS, _NUMBERS):
        raise InputError(
            f"a matrix has 16 numbers, or 12 without its last row 0 0 0 1, got {numbers.size}"
        )
    by_rows = fmt == MATRIX
    if numbers.size == _ROWS:
        part = numbers.reshape(3, 4) if by_rows else numbers.reshape(4, 3).T
        return np.vstack([part, _LAST])
    matrix = numbers.reshape(4, 4)
    right = matrix if by_rows else matrix.T
    if np.abs(right[3] - _LAST).max() > _SAME and np.abs(right[:, 3] - _LAST).max() <= _SAME:
        other = f'column by column: say rotation = "{MATRIX_COLUMNS}"'
        raise InputError(
            "is written "
            + (other if by_rows else f'row by row: say rotation = "{MATRIX}"')
            + " (where it is of the camera, in [camera_poses])"
        )
    return np.array(right)
