"""Whether a coordinate is where the arm may go: pure, held against what the registers would tell.

u95 is not added: the arm goes where it is told, however well that is known. A coordinate on a limit is
within it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.places import (
    Lasting,
    away_from_tag_mm,
    doubt_mm,
    followed_point,
    is_followed,
    lasting_numbers,
    lean_rad,
    work_tip,
)
from vgrd.geometry import Array, Pose
from vgrd.model import Bounds, CellBounds, Policy, TagObservation, TaughtPoint
from vgrd.registers import Status
from vgrd.registers.limits import LIMIT_STATUS, LimitCode

_AXES = "XYZ"
_BEHIND_RAD = math.pi / 2  # by definition
_ROUNDING_MM = 6e-4  # registers hold whole um: half of one, and some for their sums
_ROUNDING_RAD = 1e-9  # of a rotation in a register's format and back
_PLACES = {Lasting.RADIUS: LimitCode.PLACE_RADIUS, Lasting.HEIGHT: LimitCode.PLACE_HEIGHT}


@dataclass(frozen=True, slots=True)
class Excess:
    """A limit that is broken. value, limit: mm or degrees."""

    code: LimitCode
    value: float
    limit: float

    @property
    def unit(self) -> str:
        """Of value and limit."""
        return "deg" if self.code in (LimitCode.SIDE, LimitCode.CONE, LimitCode.TURN) else "mm"

    def words(self, target: str) -> str:
        """What is beyond which limit, by how much, and what to do."""
        by, unit = abs(self.value - self.limit), self.unit
        return (
            f"{target}: {self.code.description}, is at {self.value:.3f} {unit}, {by:.3f} {unit} beyond the limit "
            f"of {self.limit:.3f} {unit} ({self.code.key} of [limits], or of the target's limits): "
            f"{_remedy(self.code)}"
        )


def _remedy(code: LimitCode) -> str:
    if LIMIT_STATUS[code] is Status.OUTSIDE_CALIBRATED_VOLUME:
        return "look whether the object stands on its table; if it does, teach anew, or widen the margin"
    if code in (LimitCode.SIDE, LimitCode.CONE):
        return "look at the orientation that was asked for, and at [tool] axis; or widen the cone"
    return "put the object elsewhere, or widen the limit in the cell file and take it over: vgrd reload"


def excess_of(
    calibration: Calibration,
    target: str,
    base_from_wrist: Pose,
    policy: Policy,
    bounds: CellBounds,
    base_from_tag_b: Pose | None = None,
) -> Excess | None:
    """The first limit that a flange pose for a taught target breaks, as `excesses_of`; None where it breaks none."""
    broken = excesses_of(calibration, target, base_from_wrist, policy, bounds, base_from_tag_b)
    return next(broken, None)


def excesses_of(
    calibration: Calibration,
    target: str,
    base_from_wrist: Pose,
    policy: Policy,
    bounds: CellBounds,
    base_from_tag_b: Pose | None = None,
) -> Iterator[Excess]:
    """Every limit that a flange pose for a taught target breaks.

    base_from_tag_b: of the picture that the pose was computed from (`places.base_from_tag`).
    """
    limits, taught = bounds.of(target), calibration.taught[target]
    yield from _of_workspace(calibration, base_from_wrist, limits)
    yield from _of_place(calibration, taught, base_from_wrist, policy, limits)
    yield from _of_tag(calibration, taught, base_from_wrist, policy, limits, base_from_tag_b)
    yield from _of_window(calibration, taught, base_from_wrist, policy, limits)


def _of_workspace(
    calibration: Calibration, base_from_wrist: Pose, limits: Bounds
) -> Iterator[Excess]:
    """Box and cylinder, for the flange and for the tip."""
    yield from _of_point(base_from_wrist.translation, LimitCode.FLANGE_X, limits)
    if work_tip(calibration) is not None:
        point = followed_point(calibration, base_from_wrist)
        yield from _of_point(point, LimitCode.TIP_X, limits)


def _of_point(point: Array, first: LimitCode, limits: Bounds) -> Iterator[Excess]:
    """first: the code of X; those of Y, Z and the radius follow it."""
    radius_mm = math.hypot(point[0], point[1])
    for i, (value, low, high) in enumerate(
        (
            *zip(point, limits.lowest, limits.highest, strict=True),
            (radius_mm, limits.inner_radius_mm, limits.outer_radius_mm),
        )
    ):
        if not low - _ROUNDING_MM <= value <= high + _ROUNDING_MM:
            limit = low if value < low else high
            yield Excess(LimitCode(first + i), float(value), float(limit))


def _of_place(
    calibration: Calibration,
    taught: TaughtPoint,
    base_from_wrist: Pose,
    policy: Policy,
    limits: Bounds,
) -> Iterator[Excess]:
    """The calibrated volume: where the target can be as its object moves, and a margin."""
    if not is_followed(calibration, base_from_wrist, taught_pose(taught), policy):
        return
    then = followed_point(calibration, taught_pose(taught))
    as_taught = lasting_numbers(calibration, then, policy)
    now = lasting_numbers(calibration, followed_point(calibration, base_from_wrist), policy)
    if not as_taught:
        return
    room_mm = limits.margin_mm + doubt_mm(calibration, then) + _ROUNDING_MM
    for what, wanted_mm in as_taught.items():
        if not abs(now[what] - wanted_mm) <= room_mm:
            limit = wanted_mm + math.copysign(room_mm, now[what] - wanted_mm)
            yield Excess(_PLACES[what], now[what], limit)


def _of_tag(
    calibration: Calibration,
    taught: TaughtPoint,
    base_from_wrist: Pose,
    policy: Policy,
    limits: Bounds,
    base_from_tag_b: Pose | None,
) -> Iterator[Excess]:
    """The same by the picture alone, however the object may move."""
    if base_from_tag_b is None:
        return
    away_mm = away_from_tag_mm(
        calibration, base_from_wrist, taught_pose(taught), base_from_tag_b, policy
    )
    if not away_mm <= limits.margin_mm + _ROUNDING_MM:
        yield Excess(LimitCode.PLACE_IN_TAG, away_mm, limits.margin_mm)


def _of_window(
    calibration: Calibration,
    taught: TaughtPoint,
    base_from_wrist: Pose,
    policy: Policy,
    limits: Bounds,
) -> Iterator[Excess]:
    """How the tool stands, and how far the flange goes from where it was taught."""
    lean = lean_rad(calibration, base_from_wrist.rotation, taught.base_from_work, policy)
    way_mm, turn = taught_pose(taught).distance(base_from_wrist)
    is_behind = lean > max(_BEHIND_RAD, limits.cone_rad)
    for code, value, limit, rounding in (
        (LimitCode.SIDE if is_behind else LimitCode.CONE, lean, limits.cone_rad, _ROUNDING_RAD),
        (LimitCode.STEP, way_mm, limits.step_mm, _ROUNDING_MM),
        (LimitCode.TURN, turn, limits.step_rad, _ROUNDING_RAD),
    ):
        if not value <= limit + rounding:
            in_deg = code is not LimitCode.STEP
            told = np.degrees((value, limit)) if in_deg else (value, limit)
            yield Excess(code, float(told[0]), float(told[1]))


def taught_pose(taught: TaughtPoint) -> Pose:
    """base_from_wrist at the target as it was taught."""
    return Pose(taught.base_from_work, taught.flange_in_base)


def summary(calibration: Calibration, bounds: CellBounds) -> dict[str, object]:
    """The limits in force, in words; "beyond" names the targets that break one as they were taught."""
    beyond = {
        name: excess.words(name)
        for name, taught in calibration.taught.items()
        if (excess := excess_of(calibration, name, taught_pose(taught), Policy.FIXED, bounds))
    }
    own = {
        name: words_of(bounds.of(name)) for name in bounds.targets if name in calibration.taught
    }
    return {"cell": words_of(bounds.cell), **own, **({"beyond": beyond} if beyond else {})}


def words_of(limits: Bounds) -> str:
    """One line of all that is limited, for people."""
    box = (
        f"{low:g} to {high:g} mm in {axis}"
        for axis, low, high in zip(_AXES, limits.lowest, limits.highest, strict=True)
        if math.isfinite(low) or math.isfinite(high)
    )
    inner, outer = limits.inner_radius_mm, limits.outer_radius_mm
    radius = f"{inner:g} to {outer:g} mm from the base's z axis"
    parts = (
        *box,
        radius if inner > 0 or math.isfinite(outer) else "",
        f"target within {limits.margin_mm:g} mm of where its object can take it",
        f"tool within {math.degrees(limits.cone_rad):g} deg of the taught approach",
        f"flange within {limits.step_mm:g} mm of as taught"
        if math.isfinite(limits.step_mm)
        else "",
        f"wrist within {math.degrees(limits.step_rad):g} deg of as taught"
        if math.isfinite(limits.step_rad)
        else "",
    )
    return "; ".join(part for part in parts if part)


def way_in_base(calibration: Calibration, then: TagObservation, now: TagObservation) -> Pose:
    """How the object has moved between two pictures, base frame."""
    base_from_camera = calibration.base_from_camera
    way = now.camera_from_tag @ then.camera_from_tag.inverse()
    return base_from_camera @ way @ base_from_camera.inverse()


def carried_flange(
    calibration: Calibration, base_from_wrist: Pose, way: Pose, policy: Policy
) -> Pose:
    """Where a flange would be sent once its target has moved so (base frame)."""
    if policy is Policy.FOLLOW:
        return way @ base_from_wrist
    point = followed_point(calibration, base_from_wrist)
    shift = way @ point - point
    return Pose(base_from_wrist.rotation, base_from_wrist.translation + shift)
