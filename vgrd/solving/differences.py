"""What differs between the cell that a calibration was made for and the one that is configured.

A calibration rests on all of `CellFacts`, so all of it is compared, field by field: a field that is
added to the model is compared from then on, unless `MAY_CHANGE` says why it need not be.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np

from vgrd.geometry import Pose, log_rotation
from vgrd.model import CellFacts

ROUNDING = 1e-9  # of another processor or library; devices resolve far less (mm, px, rad)

MAY_CHANGE: Mapping[str, str] = {
    "wrist_from_tcp": (
        "no fact of the cell file but what the pendant said while teaching; it is compared with the "
        "live value all the time (404)"
    ),
    "robot_step_mm": "no fact of the cell file but how finely the robot told its poses while teaching",
    "robot_step_rad": "as robot_step_mm: how finely the robot told its poses while teaching",
    "tag_a_sigma_mm": "how well a size is known is no size: a calibration keeps what was stated when it was solved",
    "tag_b_sigma_mm": "as tag_a_sigma_mm, of tag B",
    "object.center_sigma_mm": "as tag_a_sigma_mm, of the centre of turning",
    "object.cad_sigma_mm": "as tag_a_sigma_mm, of the targets in CAD",
    "camera_stability": (
        "teaching followed the camera as its recording said, and every answer follows it as the cell "
        "file says today"
    ),
}
# Of every target: what no coordinate rests on.
MAY_CHANGE_OF_TARGETS: Mapping[str, str] = {
    "clearance_mm": "it tells how often a part goes in; answers take it from the cell file of today",
}
MAY_GROW: Mapping[str, str] = {
    "object.targets": (
        "a target that the calibration does not have changes none that it has; a request for it is "
        "refused (102) until it is taught"
    ),
}

# The keys of the cell file under which people know the facts; a fact that is not listed keeps its name.
_KEYS = {
    "mount": "camera.mount",
    "camera_matrix": "camera.matrix",
    "distortion": "camera.distortion",
    "image_size_px": "camera.size_px",
    "camera_id": "camera.id",
    "tag_a": "tags.a",
    "tag_b": "tags.b",
    "tool.axis_in_wrist": "tool.axis",
    "tool.work_from_touch_mm": "tool.work_offset_mm",
    "object.center_in_object": "object.center_mm",
    "robot_sigma_mm": "robot.sigma_mm",
    "robot_id": "robot.id",
}
_KEYS_OF_TARGETS = {"point_in_object": "point_mm", "base_from_work": "work_rotvec_deg"}


def _pinhole(matrix: object) -> object:
    """fx, fy, cx, cy of a camera matrix (3, 3)."""
    return np.asarray(matrix)[[0, 1, 0, 1], [0, 1, 2, 2]]


def _rotvec_deg(rotation: object) -> object:
    """Rotation vector in degrees of a rotation (3, 3), None of None."""
    return None if rotation is None else np.degrees(log_rotation(np.asarray(rotation))).round(6)


def _unchanged(value: object) -> object:
    return value


_AS_IN_FILE = {"camera_matrix": _pinhole, "base_from_work": _rotvec_deg}


def fact_differences(calibrated: CellFacts, configured: CellFacts) -> list[str]:
    """Every fact that differs, in words, under its key in the cell file; empty when none does."""
    return [f"{file_key(path)} {words}" for path, words in _compare(calibrated, configured, "")]


def file_key(path: str) -> str:
    """Key of the cell file for a path through `CellFacts` such as "tool.axis_in_wrist"."""
    for fact, key in _KEYS.items():
        if path == fact or path.startswith(f"{fact}."):
            return key + path.removeprefix(fact)
    start, dot, last = path.rpartition(".")
    return f"{start}{dot}{_KEYS_OF_TARGETS.get(last, last)}"


def _compare(old: object, new: object, path: str) -> Iterator[tuple[str, str]]:
    """(path, what it was and is) of everything below `path` that differs."""
    if path in MAY_CHANGE or _is_free_of_targets(path):
        return
    if is_dataclass(old) and type(old) is type(new) and not isinstance(old, Pose):
        for item in fields(old):
            below = f"{path}.{item.name}".lstrip(".")
            yield from _compare(getattr(old, item.name), getattr(new, item.name), below)
    elif isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            yield from _compare_entry(old, new, path, key)
    elif not _same(old, new, path):
        convert = _AS_IN_FILE.get(path.rpartition(".")[2], _unchanged)
        yield path, f"was {_words(convert(old))}, is {_words(convert(new))}"


def _is_free_of_targets(path: str) -> bool:
    return path.startswith("object.targets.") and path.rpartition(".")[2] in MAY_CHANGE_OF_TARGETS


def _compare_entry(
    old: Mapping[str, object], new: Mapping[str, object], path: str, key: str
) -> Iterator[tuple[str, str]]:
    if key in old and key in new:
        yield from _compare(old[key], new[key], f"{path}.{key}")
    elif key in old:
        yield f"{path}.{key}", "was there, is not there now"
    elif path not in MAY_GROW:
        yield f"{path}.{key}", "was not there, is there now"


def _same(old: object, new: object, path: str) -> bool:
    old_numbers, new_numbers = _numbers(old), _numbers(new)
    if old_numbers is not None and new_numbers is not None:
        alike = old_numbers.shape == new_numbers.shape
        return alike and np.allclose(old_numbers, new_numbers, rtol=ROUNDING, atol=ROUNDING)
    for value, numbers in ((old, old_numbers), (new, new_numbers)):
        if numbers is None and value is not None and not _has_equality(value):
            raise TypeError(f"{path}: no rule tells whether two {type(value).__name__} are equal")
    return old_numbers is None and new_numbers is None and old == new


def _numbers(value: object) -> np.ndarray | None:
    """A number, an array or a pose as an array; None for everything else."""
    if isinstance(value, Pose):
        return np.concatenate([value.translation, value.rotvec()])
    if isinstance(value, int | float | np.ndarray):
        return np.asarray(value, float)
    if isinstance(value, tuple | list) and all(isinstance(item, int | float) for item in value):
        return np.asarray(value, float)
    return None


def _has_equality(value: object) -> bool:
    """Whether == compares what it holds: text and enumerations, not our eq=False dataclasses."""
    return isinstance(value, str | Enum) or is_dataclass(value)


def _words(value: object) -> str:
    if value is None or (isinstance(value, str) and not value):
        return "none"
    if is_dataclass(value) and not isinstance(value, Pose):
        parts = (getattr(value, item.name) for item in fields(value))
        return " ".join(_words(part) for part in parts)
    if isinstance(value, Enum):
        return str(value.value)
    numbers = _numbers(value)
    return str(value if numbers is None else numbers.tolist())
