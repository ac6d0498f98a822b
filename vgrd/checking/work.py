"""The object, the tool and the touches: units that slipped, targets that fix nothing."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from vgrd.checking.remarks import Remark, doubt, fault
from vgrd.config.cell_file import (
    ObjectSection,
    PedalSection,
    RobotSection,
    ServingSection,
    ToolSection,
    TouchSection,
)
from vgrd.geometry.coincidence import are_in_line
from vgrd.judging.thresholds import LINE

_IN_METRES_MM = (
    1.0  # parts for a robot are larger than 1 mm, and none is larger than 1 m in metres
)
_FINEST_TOUCH_MM = (
    0.003  # a guess: hands reach 0.02 mm; a thousandth of a rough one, 1 mm, is less
)
_FINEST_ARM_MM = (
    0.003  # a guess: the best arms are within 0.02 mm; in metres a rough one, 1 mm, is less
)
_FINEST_HOLE_MM = 0.2  # a guess: no tip of a robot's tool goes into less
_LEAST_TARGETS = 3  # of a rigid fit of CAD points
_UNIT_LENGTH = 0.01  # of an axis: what rounding to two digits does
_ANGLE_ROUNDING = 0.005  # of a multiple of a quarter turn in rad: two digits after the point
_NO_INPUTS = "modbus_robot"  # such robots show a pose and nothing else


def target_remarks(section: ObjectSection) -> Iterator[Remark]:
    """On where the targets are in CAD."""
    known = [(i, t.point_mm) for i, t in enumerate(section.targets) if t.point_mm is not None]
    points = [point for _, point in known]
    largest = max((abs(x) for point in points for x in point), default=math.inf)
    if len(points) > 1 and largest < _IN_METRES_MM:
        yield doubt(
            f"all targets lie within {largest:g} mm of the origin: in metres? Write them in mm, "
            f"{[round(1000 * x, 6) for x in points[0]]} here",
            *_point(known[0][0]),
        )
    for place, (index, point) in enumerate(known):
        twins = [i for i, other in known[:place] if other == point]
        if twins:
            name = section.targets[twins[0]].name
            yield doubt(f"the same point as that of {name}: copied?", *_point(index))
    yield from _fit_remarks(section, points)
    for index, target in enumerate(section.targets):
        where = ("object", "targets", index)
        if target.work_rotvec_deg is not None and _is_in_rad(target.work_rotvec_deg):
            degrees = [round(math.degrees(x), 2) for x in target.work_rotvec_deg]
            words = f"{target.work_rotvec_deg} looks like radians: in degrees it is {degrees}"
            yield doubt(words, *where, "work_rotvec_deg")
        hole = target.hole_diameter_mm
        if hole is not None and hole < _FINEST_HOLE_MM:
            words = f"a hole of {hole:g} mm: in metres? Write {1000 * hole:g}"
            yield doubt(words, *where, "hole_diameter_mm")
        if hole is not None and target.clearance_mm is not None and target.clearance_mm >= hole:
            words = (
                f"{target.clearance_mm:g} mm, and the hole has {hole:g}: write the diameter of the hole minus that "
                "of what goes in"
            )
            yield fault(words, *where, "clearance_mm")


def _point(index: int) -> tuple[int | str, ...]:
    return ("object", "targets", index, "point_mm")


def _fit_remarks(section: ObjectSection, points: Sequence[Sequence[float]]) -> Iterator[Remark]:
    """Touches of CAD points tell where the object is: they must fix all of it."""
    if points and len(points) < _LEAST_TARGETS:
        yield fault(
            f"{len(points)} targets with point_mm: touches of them do not tell how the object lies. Add targets up to "
            f"{_LEAST_TARGETS} that are not on one line, or leave point_mm out",
            "object",
            "targets",
        )
    elif points and are_in_line(np.array(points), LINE):
        yield fault(
            "all targets with point_mm lie on one line, about which the object could turn: add one that lies beside "
            "it, or leave point_mm out",
            *_point(_last_with_point(section)),
        )


def _last_with_point(section: ObjectSection) -> int:
    return max(i for i, target in enumerate(section.targets) if target.point_mm is not None)


def _is_in_rad(rotvec: Sequence[float]) -> bool:
    """Whether all numbers are small and one is a multiple of a quarter turn in radians."""
    quarter = math.pi / 2
    turns = [x / quarter for x in rotvec if x]
    are_small = all(abs(x) <= 2 * math.pi + _ANGLE_ROUNDING for x in rotvec)
    return are_small and any(
        abs(turn - round(turn)) * quarter < _ANGLE_ROUNDING and round(turn) for turn in turns
    )


def center_remarks(section: ObjectSection) -> Iterator[Remark]:
    """On the axis of a turntable."""
    has_cad = any(target.point_mm is not None for target in section.targets)
    if section.motion == "turntable" and section.center_mm is None and has_cad:
        yield doubt(
            "of a turntable whose centre in CAD is not told: set center_mm = [x, y, z] for less error, or motion if "
            "the object does not turn about an axis",
            "object",
            "motion",
        )
    if section.motion != "turntable" and section.center_mm is not None:
        words = f"is of a turntable, and motion is {section.motion}: leave it out, or set motion"
        yield doubt(words, "object", "center_mm")


def touch_remarks(touch: TouchSection) -> Iterator[Remark]:
    """On how well the operator touches."""
    for key in ("lateral_sigma_mm", "axial_sigma_mm"):
        sigma = getattr(touch, key)
        if sigma < _FINEST_TOUCH_MM:
            words = f"{sigma:g} mm, no hand touches so well: in metres? Write {1000 * sigma:g}"
            yield doubt(words, "touch", key)


def robot_remarks(robot: RobotSection) -> Iterator[Remark]:
    """On how well the arm knows where it is."""
    if robot.sigma_mm < _FINEST_ARM_MM:
        words = f"{robot.sigma_mm:g} mm, no arm is so exact: in metres? Write {1000 * robot.sigma_mm:g}"
        yield doubt(words, "robot", "sigma_mm")


def tool_remarks(tool: ToolSection) -> Iterator[Remark]:
    """On the direction of the tool."""
    length = math.hypot(*tool.axis)
    if abs(length - 1) > _UNIT_LENGTH:
        unit = [round(x / length, 4) for x in tool.axis]
        yield doubt(
            f"is a direction of length 1, this one has {length:g}: is it where the tip is? Touches tell that; write "
            f"{unit}",
            "tool",
            "axis",
        )


def pedal_remarks(pedal: PedalSection, robot: RobotSection) -> Iterator[Remark]:
    """On what records a touch."""
    if pedal.robot_input is not None and robot.driver == _NO_INPUTS:
        words = f"{_NO_INPUTS} tells no digital inputs: take a pedal (driver = 'serial_pedal')"
        yield fault(words, "pedal", "robot_input")


def serving_remarks(serving: ServingSection) -> Iterator[Remark]:
    """On what an answer must satisfy."""
    if serving.warn_u95_mm > serving.max_u95_mm:
        words = (
            f"{serving.warn_u95_mm:g} mm is above max_u95_mm ({serving.max_u95_mm:g}), where answers are refused: "
            "nothing is ever told as degraded; write half of it"
        )
        yield doubt(words, "serving", "warn_u95_mm")
