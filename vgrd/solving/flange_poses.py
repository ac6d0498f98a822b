"""Flange poses as files hold them: how they are written, and what is wrong with them together."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator

from vgrd.documents.tables import Number, Table, one_of
from vgrd.geometry import Pose
from vgrd.geometry.coincidence import equal_poses
from vgrd.geometry.pose_formats import POSE_FORMATS
from vgrd.judging.thresholds import SAME_TEXT_MM, SAME_TEXT_RAD

MIN_SAMPLES = 3  # the least of a hand-eye calibration

_REACH_MM = 20_000.0  # no arm reaches 20 m: it is another unit

_SMALLEST_ARM_MM = 10.0  # no arm stays within 10 mm: it is another unit


def arm_faults(named: Sequence[tuple[str, Pose]], unit: str, table: str) -> list[str]:
    """What is wrong with flange poses together: unit, repeats, a stream that never changed."""
    if len(named) < MIN_SAMPLES:
        return []
    faults = []
    places = np.array([pose.translation for _, pose in named])
    reach = float(np.abs(places).max())
    turns_about_a_point = float(np.ptp(places, axis=0).max()) <= SAME_TEXT_MM  # a pan-tilt head
    if reach > _REACH_MM:
        metres = reach / 1000
        return [f"poses.unit: in {unit} the flange is {metres:.3g} m from the base: is it mm?"]
    if reach < _SMALLEST_ARM_MM and not turns_about_a_point:
        faults.append(
            f"poses.unit: in {unit} no flange is more than {reach:.2g} mm from the base: is it m?"
        )
    return faults + equal_pose_faults(named, f"{table}.pose", "robot")


def equal_pose_faults(named: Sequence[tuple[str, Pose]], key: str, source: str) -> list[str]:
    """Poses that equal each other; key: of the file, source: what should have told new ones."""
    if not named:
        return []
    groups: dict[int, list[str]] = {}
    equal = equal_poses([pose for _, pose in named], SAME_TEXT_MM, SAME_TEXT_RAD)
    for (name, _), first in zip(named, np.argmax(equal, axis=1), strict=True):
        groups.setdefault(int(first), []).append(name)
    if len(named) > 1 and len(groups) == 1:
        return [
            f"{key}: all {len(named)} are equal: the {source} was not read again between "
            "the samples; record anew"
        ]
    return [
        f"{key}: {', '.join(repr(name) for name in names)} hold the same pose: the {source} "
        "did not move or was not read again; keep one of them"
        for names in groups.values()
        if len(names) > 1
    ]


def flat(value: object) -> object:
    """Rows of numbers as one list; what is no list of lists stays as it is."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value


Numbers = Annotated[list[Number], BeforeValidator(flat)]
Unit = Annotated[str, one_of(("mm", "m"))]
PoseFormat = Annotated[str, one_of(POSE_FORMATS)]


class PosesTable(Table):
    """How the flange poses are written: x, y, z and the rotation, or a matrix."""

    unit: Unit
    rotation: PoseFormat
