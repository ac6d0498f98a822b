"""The file of touches, checked: every fault of it in one message."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from vgrd.calibration.tcp import Plane
from vgrd.calibration.touches import TouchSet, touch_set
from vgrd.documents.tables import (
    LengthMm,
    NamedTable,
    Number,
    Table,
    TableT,
    named_rows,
    one_of,
    parse,
    tables_of,
)
from vgrd.documents.toml import one_word, read_toml, unknown_keys
from vgrd.errors import ConfigError, InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.coincidence import are_in_line
from vgrd.geometry.pose_formats import robot_numbers, written_pose
from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.judging.thresholds import LINE
from vgrd.solving.flange_poses import Numbers, PosesTable, arm_faults

DEFAULT_SIGMA_MM = 0.233  # the paper's touches, experiment B
_TABLES = ("kind", "poses", "touch", "plane", "sphere", "orientation")
_AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
_SIGMAS_MM = (1e-3, 100.0)  # no hand and no arm is better; a rougher touch tells nothing
_SAME_AXIS = 1e-6  # rounding of a text

Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


def _sigma(value: float) -> float:
    if not (_SIGMAS_MM[0] <= value <= _SIGMAS_MM[1] or value == np.inf):
        raise ValueError(
            f"{value:g} mm is no touch: give {_SIGMAS_MM[0]:g} to {_SIGMAS_MM[1]:g}, or inf where "
            "nothing was measured"
        )
    return value


SigmaMm = Annotated[float, AfterValidator(_sigma)]


class TouchKind(StrEnum):
    """What was touched."""

    UNIVERSAL = "universal"
    FIXED_POINT = "fixed-point"
    PLANE = "plane"
    SPHERE = "sphere"


class TouchTable(NamedTable):
    """One touch: the flange's pose in the base and, universal, the CAD point in mm."""

    pose: Numbers
    target: Vector | None = None
    axis: Vector | None = None
    sigma_mm: Annotated[list[SigmaMm], Field(min_length=2, max_length=2)] | None = None


class OrientationTable(NamedTable):
    """A flange pose in which the fixed point lies on an axis of the tool, seen from the tip."""

    pose: Numbers
    point_on: Annotated[str, one_of(_AXES)]


class PlaneTable(Table):
    """A plane that is known: its normal and one of its points in the base, mm."""

    normal: Vector
    point: Vector


class SphereTable(Table):
    """A ball of known radius (the tip's own included), mm."""

    radius_mm: LengthMm


_NEEDED: Mapping[TouchKind, tuple[int, int]] = MappingProxyType(
    {  # touches, without and with the surface's own table
        TouchKind.UNIVERSAL: (4, 4),  # 9 unknowns by 3 equations each, and one touch to check them
        TouchKind.FIXED_POINT: (3, 3),  # two orientations leave the TCP open along their axis
        TouchKind.PLANE: (6, 3),  # one equation each: TCP 3, plane 3
        TouchKind.SPHERE: (7, 6),  # TCP 3, centre 3, radius 1
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class TouchFile:
    """m checked touches; points_in_object: (m, 3) mm, zeros unless kind is universal.

    sigma_given: (m,), whether the file gives the sigma of a touch. rotations: (m, 3 or 4), the numbers
    of the orientations as they are written, and rotation_format how they are said to be meant. axis_poses: two
    flange poses with the axis of the tool on which the fixed point lay, such as "+z", or none. by_matrix: the file
    writes 4x4 matrices; rotations are quaternions (x, y, z, w) then.
    """

    kind: TouchKind
    names: tuple[str, ...]
    touches: TouchSet
    points_in_object: Array
    sigma_given: tuple[bool, ...]
    rotations: Array
    rotation_format: RotationFormat
    plane: Plane | None = None
    radius_mm: float | None = None
    axis_poses: tuple[tuple[str, Pose], ...] = ()
    by_matrix: bool = False

    def subset(self, chosen: NDArray[np.intp]) -> "TouchFile":
        """The same with the touches of these indices."""
        return replace(
            self,
            names=tuple(self.names[i] for i in chosen),
            touches=self.touches.subset(chosen),
            points_in_object=self.points_in_object[chosen],
            sigma_given=tuple(self.sigma_given[i] for i in chosen),
            rotations=self.rotations[chosen],
        )

    def with_poses(self, rotations: Array, translations: Array) -> "TouchFile":
        """The same touches with other flange poses: (m, 3, 3) and (m, 3) mm."""
        return replace(
            self, touches=replace(self.touches, rotations=rotations, translations=translations)
        )


def load_touches(path: Path) -> TouchFile:
    """Read and check a file of touches; ConfigError holds every fault with its key and remedy."""
    data = read_toml(path, "a file of touches (.toml)")
    faults = unknown_keys(data, _TABLES)
    kind = _kind(data, faults)
    poses = parse(PosesTable, data.get("poses", {}), "poses", faults)
    rows = _rows(data, kind, faults)
    plane = _plane(_surface(data, kind, TouchKind.PLANE, PlaneTable, faults), faults)
    sphere = _surface(data, kind, TouchKind.SPHERE, SphereTable, faults)
    arm = _arm(rows, poses, faults)
    axis_poses = _axis_poses(data, kind, poses, faults)
    axis = _axis([row for _, row in rows], faults)
    points = np.array([row.target or (0, 0, 0) for _, row in rows], dtype=np.float64)
    if kind is TouchKind.UNIVERSAL and not faults:
        faults += _line_faults(points)
    if faults or kind is None or poses is None:
        raise ConfigError(str(path), _told_once(faults))
    written = [
        robot_numbers(row.pose, pose, poses.rotation, poses.unit)
        for (_, row), pose in zip(rows, arm, strict=True)
    ]
    sigmas = [row.sigma_mm or (DEFAULT_SIGMA_MM, DEFAULT_SIGMA_MM) for _, row in rows]
    return TouchFile(
        kind=kind,
        names=tuple(row.name for _, row in rows),
        touches=touch_set(arm, axis, [s[0] for s in sigmas], [s[1] for s in sigmas]),
        points_in_object=points.reshape(-1, 3),
        sigma_given=tuple(row.sigma_mm is not None for _, row in rows),
        rotations=np.array([numbers[3:] for numbers, _ in written]),
        rotation_format=written[0][1],
        by_matrix=poses.rotation not in tuple(RotationFormat),
        plane=plane,
        radius_mm=sphere.radius_mm if sphere else None,
        axis_poses=axis_poses,
    )


def _told_once(faults: Sequence[str]) -> list[str]:
    """The faults, of those that say the same of several touches the first with a count."""
    places: dict[str, list[str]] = {}
    for fault in faults:
        place, _, words = fault.partition(": ")
        places.setdefault(words, []).append(place)
    return [
        f"{first}: {words}" + (f" (and {len(rest)} more)" if rest else "")
        for words, (first, *rest) in places.items()
    ]


def _kind(data: dict[str, Any], faults: list[str]) -> TouchKind | None:
    kinds = tuple(TouchKind)
    word = one_word(data, "kind", kinds, f"one of {', '.join(kinds)}", faults)
    return None if word is None else TouchKind(word)


def _rows(
    data: dict[str, Any], kind: TouchKind | None, faults: list[str]
) -> list[tuple[str, TouchTable]]:
    """The [[touch]] tables that can be read, each with the words that name it in a message."""
    tables = tables_of(data, "touch", faults)
    if tables is None:
        return []
    if kind is not None:
        needed = _NEEDED[kind][kind.value in data]
        if len(tables) < needed:
            faults.append(f"touch: {len(tables)} given, kind {kind} needs at least {needed}")
    rows = named_rows(TouchTable, "touch", tables, faults)
    if kind is TouchKind.UNIVERSAL:
        faults += [
            f"{label}.target: is missing, add the CAD point [x, y, z] in mm"
            for label, row in rows
            if row.target is None
        ]
    return rows


def _surface(
    data: dict[str, Any],
    kind: TouchKind | None,
    table_kind: TouchKind,
    model: type[TableT],
    faults: list[str],
) -> TableT | None:
    """The [plane] or [sphere] table where there is one."""
    if table_kind.value not in data:
        return None
    if kind not in (table_kind, None):
        faults.append(
            f"{table_kind}: kind {kind} has no [{table_kind}]; remove the table or correct kind"
        )
    return parse(model, data[table_kind.value], table_kind.value, faults)


def _plane(table: PlaneTable | None, faults: list[str]) -> Plane | None:
    if table is None:
        return None
    length = float(np.linalg.norm(table.normal))
    if length == 0:
        faults.append("plane.normal: has no length; give the direction out of the plane")
        return None
    n = np.array(table.normal) / length
    return Plane(n, float(n @ np.array(table.point)))


def _arm(
    rows: Sequence[tuple[str, TouchTable]], poses: PosesTable | None, faults: list[str]
) -> list[Pose]:
    """The flange poses in mm."""
    if poses is None:
        return []
    arm = _read_poses(rows, poses, faults)
    if len(arm) == len(rows):
        named = [(row.name, pose) for (_, row), pose in zip(rows, arm, strict=True)]
        faults += arm_faults(named, poses.unit, "touch")
    return arm


def _read_poses(
    rows: Sequence[tuple[str, TouchTable | OrientationTable]], poses: PosesTable, faults: list[str]
) -> list[Pose]:
    """Those that can be read, mm."""
    read = []
    for label, row in rows:
        try:
            read.append(written_pose(row.pose, poses.rotation, poses.unit))
        except InputError as error:
            faults.append(f"{label}.pose: {error}")
    return read


def _axis_poses(
    data: dict[str, Any], kind: TouchKind | None, poses: PosesTable | None, faults: list[str]
) -> tuple[tuple[str, Pose], ...]:
    """The two [[orientation]] tables, none where there are none."""
    tables = tables_of(data, "orientation", faults)
    if not tables or poses is None:
        return ()
    if kind not in (TouchKind.FIXED_POINT, None):
        faults.append(f"orientation: kind {kind} has no fixed point; remove the tables")
    rows = named_rows(OrientationTable, "orientation", tables, faults)
    axes = [row.point_on for _, row in rows]
    if len(tables) != 2 or (len(rows) == 2 and axes[0][1] == axes[1][1]):
        faults.append(
            "orientation: give two poses, the fixed point on one axis of the tool and beside it towards "
            'another one, such as point_on = "+z" and "+x"'
        )
    read = _read_poses(rows, poses, faults)
    return tuple(zip(axes, read, strict=False))


def _axis(rows: Sequence[TouchTable], faults: list[str]) -> Array:
    """The tool's axis (3,) in the wrist frame, one for all touches."""
    directions = np.array([row.axis for row in rows if row.axis is not None], dtype=np.float64)
    if not len(directions):
        return np.array([0.0, 0.0, 1.0])
    lengths = np.linalg.norm(directions, axis=1)
    if not lengths.all():
        faults.append(
            "touch.axis: has no length; give the direction out of the tip, such as 0 0 1"
        )
        return np.array([0.0, 0.0, 1.0])
    axes = directions / lengths[:, None]
    if np.abs(axes - axes[0]).max() > _SAME_AXIS:
        faults.append("touch.axis: differs between touches; one tool has one axis in the flange")
    return np.asarray(axes[0])


def _line_faults(points: Array) -> list[str]:
    if not np.ptp(points, axis=0).any():
        return ["touch.target: all are equal; touch at least 4 CAD points that are far apart"]
    if are_in_line(points, LINE):
        return ["touch.target: all are on one line; touch a point beside it too"]
    return []
