"""Orientation of a tool by two more touched points, the six-point method of robot pendants.

The flange is brought where the fixed point lies on an axis of the tool, as seen from the tip; a second pose has it
beside that axis, on the side of another one. In the wrist the fixed point then stands at R_j^T (c - t_j).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose, log_rotation

_STEP_MM = 1e-3  # of central differences: exact to 1e-9 at directions of 10 mm and more
_LEAST_MM = 5.0  # from the tip: a touch of 0.2 mm tells a nearer direction to 2 degrees only
_IN_LINE = 0.1  # sine of the angle between the two directions, 6 degrees


@dataclass(frozen=True, slots=True, eq=False)
class AxisPoint:
    """Flange pose in which the fixed point lies on an axis of the tool (0, 1, 2 for x, y, z), positive or negative.

    covariance: (3, 3) mm^2, in the base, of where the tool stood.
    """

    base_from_wrist: Pose
    axis: int
    sign: int
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class ToolOrientation:
    """wrist_from_tool: rotation (3, 3); covariance: (3, 3) rad^2, of small turns about the axes of the wrist."""

    wrist_from_tool: Array
    covariance: Array


def tool_orientation(
    points: Sequence[AxisPoint], tcp_in_wrist: Array, point_in_base: Array, covariance: Array
) -> ToolOrientation:
    """By two points: the first gives its axis exactly, the second its side.

    tcp_in_wrist, point_in_base: (3,) mm, with covariance (6, 6) of both. Raises NotObservable where a point
    is too near the tip, or both lie in one direction.
    """

    def rotation(x: Array) -> Array:
        tcp, c = x[:3], x[3:6]
        directions = [
            p.sign
            * (p.base_from_wrist.rotation.T @ (c - p.base_from_wrist.translation - off) - tcp)
            for p, off in zip(points, x[6:].reshape(2, 3), strict=True)
        ]
        return _frame(directions, [p.axis for p in points])

    known = np.concatenate([tcp_in_wrist, point_in_base, np.zeros(6)])
    R = rotation(known)
    J = _derivative(rotation, R, known)
    spread = np.zeros((12, 12))
    spread[:6, :6] = covariance
    for k, point in enumerate(points):
        spread[6 + 3 * k : 9 + 3 * k, 6 + 3 * k : 9 + 3 * k] = point.covariance
    return ToolOrientation(R, J @ spread @ J.T)


def _derivative(rotation: Callable[[Array], Array], R: Array, known: Array) -> Array:
    """How R (3, 3) turns, (3, n), with the numbers (n,) that it rests on."""
    columns = []
    for step in _STEP_MM * np.eye(len(known)):
        ahead, behind = (log_rotation(rotation(known + s * step) @ R.T) for s in (1, -1))
        columns.append((ahead - behind) / (2 * _STEP_MM))
    return np.array(columns).T


def _frame(directions: Sequence[Array], axes: Sequence[int]) -> Array:
    """Rotation whose column axes[0] is along the first direction, axes[1] on the side of the second."""
    lengths = [float(np.linalg.norm(d)) for d in directions]
    if min(lengths) < _LEAST_MM:
        raise NotObservable(
            f"orientation: the fixed point is {min(lengths):.1f} mm from the tip; move it {_LEAST_MM:.0f} mm away "
            "or more, better 50",
            rank=0,
            unknowns=3,
        )
    first = directions[0] / lengths[0]
    beside = directions[1] - first * (first @ directions[1])
    length = float(np.linalg.norm(beside))
    if length < _IN_LINE * lengths[1]:
        raise NotObservable(
            "orientation: both points lie in one direction from the tip; give the second one beside it",
            rank=2,
            unknowns=3,
        )
    R = np.zeros((3, 3))
    R[:, axes[0]], R[:, axes[1]] = first, beside / length
    last = 3 - axes[0] - axes[1]
    R[:, last] = np.cross(R[:, (last + 1) % 3], R[:, (last + 2) % 3])
    return R
