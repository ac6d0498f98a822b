"""Which columns of a table are poses: by their names, and by the shape of their cells."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgrd.documents.sheets import Sheet, finite
from vgrd.errors import InputError

UNITS = {
    "mm": "mm",
    "millimeter": "mm",
    "millimeters": "mm",
    "m": "m",
    "meter": "m",
    "meters": "m",
}
_ANGLES = ("deg", "degree", "degrees", "rad", "radian", "radians")
_PLACE_WORDS = frozenset(
    (
        *("position", "positions", "pos", "translation", "translations", "trans", "p", "xyz"),
        *("t", "ts", "tvec", "tvecs"),
    )
)
_TURN_WORDS = frozenset(
    (
        *("orientation", "rotation", "rot", "quaternion", "quat", "q", "r", "rvec", "rotvec"),
        *("axisangle", "euler", "rpy", "ori", "angle", "rs", "rvecs", "rotations", "quaternions"),
    )
)
_ROLE_WORDS = _PLACE_WORDS | _TURN_WORDS | {"pose", "transform", "matrix", "values", "h"}
_TRIPLES = {  # names of three angles, and what robots of that naming write
    ("roll", "pitch", "yaw"): "rpy",
    ("a", "b", "c"): "abc",
    ("w", "p", "r"): "wpr",
    ("rx", "ry", "rz"): "rotation",
    ("rvecx", "rvecy", "rvecz"): "rotvec",
    ("o", "a", "t"): "oat",
    ("u", "v", "w"): "uvw",
}
_PLACES = (("x", "y", "z"), ("tx", "ty", "tz"), ("px", "py", "pz"), ("posx", "posy", "posz"))
_QUATERNIONS = (("qx", "qy", "qz", "qw"), ("x", "y", "z", "w"), ("i", "j", "k", "w"))
_NUMBERED = (
    ("q1", "q2", "q3", "q4"),
    ("q0", "q1", "q2", "q3"),
)  # the scalar first: ABB, textbooks
CAMERA_SIDE = re.compile(
    r"cam(?!era2base)|target|board|marker|tag|track|object|sensor|pattern|check|chess|charuco|aruco|"
    r"rvec|tvec|^cto|optical"
)
ROBOT_SIDE = re.compile(
    r"robot|flange|gripper|effector|eef|^ee|tcp|hand|base|arm|wrist|tool|world|^bt|rob|^end"
)


@dataclass(frozen=True, slots=True, eq=False)
class PoseColumns:
    """Poses or places found in a table.

    label: of the columns, for messages; rows (n, k): x y z and the rotation, or a matrix of 12; turn: "matrix",
    "none", a word of _TRIPLES, "rotvec", "xyzw", "wxyz", "four" or "three" numbers of unknown order; unit,
    degrees: as the names say, None where they do not; side: "robot", "camera" or None.
    """

    label: str
    rows: np.ndarray[Any, Any]
    turn: str
    unit: str | None
    degrees: bool | None
    side: str | None
    inverted: bool = False


def tokens_of(name: str) -> list[str]:
    """Words of a column's name: "Flange.Position.X [mm]" is flange, position, x, mm."""
    split = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"[^a-z0-9]+", split.lower()) if word]


def pose_columns(sheet: Sheet) -> list[PoseColumns]:
    """Everything in the table that is a pose or a place, in the order of the columns."""
    return [*_of_cells(sheet), *_of_numbers(sheet)]


def words_in(sheet: Sheet) -> Mapping[str, Sequence[str]]:
    """Columns of words."""
    return {
        name: [str(cell) for cell in cells]
        for name, cells in sheet.columns.items()
        if cells and all(isinstance(cell, str) for cell in cells)
    }


def _of_numbers(sheet: Sheet) -> list[PoseColumns]:
    """Groups of columns with one number a cell, by what their names have in common."""
    groups: dict[str, dict[str, str]] = {}
    for name, cells in sheet.columns.items():
        numbers = [isinstance(cell, int | float) and not isinstance(cell, bool) for cell in cells]
        if 2 * sum(numbers) <= len(
            cells
        ):  # one that is empty in some rows is named when it is used
            continue
        prefix, component = _component(name)
        groups.setdefault(prefix, {})[component] = name
    found = [_group(sheet, prefix, columns) for prefix, columns in groups.items()]
    return [group for group in found if group is not None]


def _component(name: str) -> tuple[str, str]:
    """What a column belongs to, and which component of it: "tool.rotation.x" is ("tool", "r.x")."""
    tokens = [word for word in tokens_of(name) if word not in UNITS and word not in _ANGLES]
    if not tokens:
        return "", ""
    last, rest = tokens[-1], tokens[:-1]
    joined = re.fullmatch(r"(tvec|rvec|pos|quat|trans)([xyz012w])", last)
    if joined:
        rest, last = [*rest, joined[1]], joined[2]
    role = "r" if rest and rest[-1] in _TURN_WORDS else "t"
    if last.isdigit() and rest and rest[-1] in (_PLACE_WORDS | _TURN_WORDS):
        last = f"#{last}"
    if last in ("x", "y", "z", "w") or last.startswith("#"):
        last = f"{role}.{last}"
    side_words = [word for word in rest if word not in _ROLE_WORDS]
    is_opencv = not side_words and any(word in ("rvec", "tvec") for word in rest)
    return "opencv rvec" if is_opencv else " ".join(side_words), last


def _group(sheet: Sheet, prefix: str, columns: Mapping[str, str]) -> PoseColumns | None:
    place = _first(columns, [[f"t.{c}" for c in "xyz"], *_PLACES, [f"t.#{i}" for i in range(3)]])
    if place is None:
        return _unnamed(sheet, columns) if not prefix else None
    turn, names = _turn(columns)
    used = [*place, *names]
    words = {word for name in used for word in tokens_of(name)}
    return PoseColumns(
        label=", ".join(used),
        rows=_numbers(sheet, used),
        turn=turn,
        unit=next((UNITS[word] for word in words if word in UNITS), None),
        degrees=_degrees(words),
        side=side_of(prefix),
        inverted=_is_inverted(prefix),
    )


def _turn(columns: Mapping[str, str]) -> tuple[str, list[str]]:
    """The kind of rotation and its columns."""
    quaternion = _first(columns, [*_QUATERNIONS, [f"r.{c}" for c in "xyzw"]])
    if quaternion is not None:
        return "xyzw", quaternion
    scalar_first = _first(columns, _NUMBERED)
    if scalar_first is not None:
        return "wxyz", scalar_first
    for names, kind in _TRIPLES.items():
        found = _first(columns, [names])
        if found is not None:
            return kind, found
    for count, kind in ((4, "four"), (3, "rotation")):
        numbered = _first(columns, [[f"r.#{i}" for i in range(count)]])
        if numbered is not None:
            is_vector = any(t in ("rvec", "rotvec") for t in tokens_of(numbered[0]))
            return ("rotvec" if is_vector else kind), numbered
    letters = _first(columns, [[f"r.{c}" for c in "xyz"]])
    return ("rotation", letters) if letters is not None else ("none", [])


def _unnamed(sheet: Sheet, columns: Mapping[str, str]) -> PoseColumns | None:
    """A table without a header: x y z and the rotation in 6 or 7 numbers, or a matrix in 12 or 16."""
    names = sorted((name for name in columns.values() if name.isdigit()), key=int)
    shapes = {6: "rotation", 7: "four", 8: "xyzw", 12: "matrix", 16: "matrix"}
    if len(names) not in shapes or len(names) != len(sheet.columns):
        return None
    turn = shapes[len(names)]
    names = names[1:] if turn == "xyzw" else names  # a trajectory: the time first
    rows = _numbers(sheet, names)
    rows = _as_rows(rows, "no header") if turn == "matrix" else rows
    return PoseColumns(f"{len(names)} numbers a row", rows, turn, None, None, None)


def _of_cells(sheet: Sheet) -> list[PoseColumns]:
    """Columns whose cells hold lists of numbers; R and t of one name together."""
    parts: dict[str, dict[str, tuple[str, np.ndarray[Any, Any]]]] = {}
    for name, cells in sheet.columns.items():
        if not cells or not all(isinstance(cell, list) for cell in cells):
            continue
        try:
            values = [
                finite(cell, f"{p}, {name}") for p, cell in zip(sheet.places, cells, strict=True)
            ]
        except InputError:
            if any(isinstance(leaf, str) for cell in cells for leaf in cell):
                continue
            raise
        if len({len(numbers) for numbers in values}) != 1:
            continue
        words = tokens_of(name)
        prefix = " ".join(word for word in words if word not in _ROLE_WORDS)
        if not prefix and {"rvec", "tvec", "rvecs", "tvecs"} & set(words):
            prefix = "opencv rvec"
        kind = _cell_kind(words, len(values[0]))
        parts.setdefault(prefix if kind in ("R", "t", "rotvec", "q") else name, {})[kind] = (
            name,
            np.array(values),
        )
    return [group for name, part in parts.items() if (group := _joined(name, part)) is not None]


def _cell_kind(words: Sequence[str], count: int) -> str:
    if count == 9:
        return "R"
    if count == 4:
        return "q"
    if count == 3:
        turns = {
            "r",
            "rs",
            "rvec",
            "rvecs",
            "rotations",
            "rotvec",
            "rot",
            "rotation",
            "euler",
            "rpy",
            "orientation",
        }
        return "rotvec" if turns & set(words) else "t"
    return {6: "rotation", 7: "four", 12: "matrix", 16: "matrix"}.get(count, "other")


def _joined(
    prefix: str, part: Mapping[str, tuple[str, np.ndarray[Any, Any]]]
) -> PoseColumns | None:
    """One pose of its parts."""
    label = ", ".join(name for name, _ in part.values())
    words = set(tokens_of(label))
    side, inverted = side_of(" ".join(tokens_of(prefix))), _is_inverted(prefix)
    unit = next((UNITS[word] for word in words if word in UNITS and word != "m"), None)
    if "matrix" in part:
        rows, turn = _as_rows(part["matrix"][1], label), "matrix"
    elif "t" in part and "R" in part:
        R, t = part["R"][1].reshape(-1, 3, 3), part["t"][1].reshape(-1, 3, 1)
        rows, turn = np.concatenate([R, t], axis=2).reshape(-1, 12), "matrix"
    elif "t" in part and ("rotvec" in part or "q" in part):
        key, turn = ("q", "four") if "q" in part else ("rotvec", "rotvec")
        rows = np.hstack([part["t"][1], part[key][1]])
    elif "t" in part:
        rows, turn = part["t"][1], "none"
    else:
        turn = next((kind for kind in ("rotation", "four") if kind in part), "")
        if not turn:
            return None
        rows = part[turn][1]
    return PoseColumns(label, rows, turn, unit, _degrees(words), side, inverted)


def _as_rows(rows: np.ndarray[Any, Any], label: str) -> np.ndarray[Any, Any]:
    """Matrices (n, 12) row by row of 12 or 16 numbers, whichever way they were written."""
    if rows.shape[1] == 12:
        return rows
    square = rows.reshape(-1, 4, 4)
    last = np.array([0.0, 0, 0, 1])
    if np.abs(square[:, 3] - last).max() < 1e-6:
        return square[:, :3].reshape(-1, 12)
    if np.abs(square[:, :, 3] - last).max() < 1e-6:
        return np.swapaxes(square, 1, 2)[:, :3].reshape(-1, 12)
    raise InputError(f"{label}: 16 numbers that are no matrix with 0 0 0 1 at its end")


def side_of(words: str) -> str | None:
    """Which side of a calibration a name tells of; the first word that tells it decides."""
    if words.startswith("opencv"):
        return "camera"
    camera, robot = CAMERA_SIDE.search(words), ROBOT_SIDE.search(words)
    if camera and robot:
        return "camera" if camera.start() < robot.start() else "robot"
    return "camera" if camera else "robot" if robot else None


def _is_inverted(words: str) -> bool:
    """Names such as base2gripper and cam2target: they map the other way."""
    plain = words.lower().replace(" ", "").replace("_", "")
    return bool(
        re.search(r"(base|world)(2|to)(gripper|flange|hand|ee|tool|tcp|end|wrist)", plain)
        or re.search(r"(gripper|flange|hand|ee|tool|tcp|wrist)from(base|world)", plain)
        or re.search(r"cam(era)?(2|to)(target|board|marker|tag|object)", plain)
        or re.search(r"(target|board|marker|tag|object)fromcam", plain)
    )


def _degrees(words: set[str]) -> bool | None:
    if words & {"deg", "degree", "degrees"}:
        return True
    return False if words & {"rad", "radian", "radians"} else None


def _first(columns: Mapping[str, str], choices: Sequence[Sequence[str]]) -> list[str] | None:
    for names in choices:
        if all(name in columns for name in names):
            return [columns[name] for name in names]
    return None


def _numbers(sheet: Sheet, names: Sequence[str]) -> np.ndarray[Any, Any]:
    return np.array(
        [
            [
                x
                for name in names
                for x in finite(sheet.columns[name][i], f"{place}, column '{name}'")
            ]
            for i, place in enumerate(sheet.places)
        ]
    )
