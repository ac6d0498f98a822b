"""In which format, unit and mount the numbers of a recording are meant: by names, sizes, and what fits best.

Where robot and camera poses are both there, every reading is tried (`vgrd.calibration.checks.agreement`); otherwise
names and sizes decide, and what is assumed is told.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from vgrd.calibration.checks import Poses, agreement
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.pose_formats import MATRIX, written_pose
from vgrd.geometry.rotation_formats import RotationFormat as Format
from vgrd.importing.columns import PoseColumns
from vgrd.model import Mount

_MOST_RAD = 2 * np.pi + 0.01  # a larger angle is in degrees
_METRES_REACH = 8.0  # no arm reaches 8 m, and none works within 8 mm: below it lengths are metres
_ENOUGH = 4  # samples that can tell a reading: three fit many
_CLEARLY = 0.6  # of the misfit of the usual reading: what else has to fit better
_KINDS: Mapping[str, tuple[Format, Format]] = {  # in radians, in degrees
    "rpy": (Format.RPY_FIXED_XYZ, Format.RPY_FIXED_XYZ_DEG),
    "rotvec": (Format.ROTVEC, Format.ROTVEC_DEG),
    "abc": (Format.KUKA_ABC_DEG, Format.KUKA_ABC_DEG),
    "wpr": (Format.FANUC_WPR_DEG, Format.FANUC_WPR_DEG),
    "oat": (Format.KAWASAKI_OAT_DEG, Format.KAWASAKI_OAT_DEG),
    "uvw": (Format.EPSON_UVW_DEG, Format.EPSON_UVW_DEG),
}
_THREE_RAD = (Format.ROTVEC, Format.RPY_FIXED_XYZ)
_THREE_DEG = (
    *(Format.RPY_FIXED_XYZ_DEG, Format.KUKA_ABC_DEG, Format.STAUBLI_RXRYRZ_DEG),
    *(Format.ZYZ_DEG, Format.ROTVEC_DEG),
)


@dataclass(frozen=True, slots=True)
class Reading:
    """How both sides are meant; camera_format None without camera poses; inverted: of the robot's poses."""

    mount: Mount
    robot_format: str
    robot_unit: str
    camera_format: str | None
    camera_unit: str | None
    inverted: bool


@dataclass(frozen=True, slots=True)
class Said:
    """What the user says with --as; None where the data decide."""

    mount: Mount | None = None
    rotation: str | None = None
    unit: str | None = None
    camera_rotation: str | None = None
    camera_unit: str | None = None


def unit_of(group: PoseColumns) -> str:
    """Mm or m, by the names, else by the largest coordinate."""
    if group.unit is not None:
        return group.unit
    places = group.rows[:, 3::4] if group.turn == MATRIX else group.rows[:, :3]
    return "m" if np.abs(places).max() < _METRES_REACH else "mm"


def formats_of(group: PoseColumns) -> list[str]:
    """Formats that the numbers may have, the usual one first."""
    match group.turn:
        case "matrix" | "none":
            return [group.turn]
        case "xyzw":
            return [Format.QUATERNION_XYZW]
        case "wxyz":
            return [Format.QUATERNION_WXYZ]
        case "four":
            return [Format.QUATERNION_XYZW, Format.QUATERNION_WXYZ]
    degrees = group.degrees
    if degrees is None:
        degrees = bool(np.abs(group.rows[:, 3:6]).max() > _MOST_RAD)
    if group.turn in _KINDS:
        return [_KINDS[group.turn][degrees]]
    return list(_THREE_DEG if degrees else _THREE_RAD)


def poses_of(group: PoseColumns, fmt: str, unit: str) -> list[Pose]:
    """The poses, mm; InputError names the first that is none."""
    poses = []
    for number, row in enumerate(group.rows):
        try:
            poses.append(written_pose([float(x) for x in row], fmt, unit))
        except InputError as error:
            raise InputError(f"{group.label}, row {number}: {error}") from error
    return poses


def places_of(group: PoseColumns, unit: str) -> Array:
    """The places (n, 3), mm."""
    columns = group.rows[:, 3::4] if group.turn == MATRIX else group.rows[:, :3]
    return np.asarray(columns * (1000.0 if unit == "m" else 1.0))


def read(robot: PoseColumns, camera: PoseColumns | None, said: Said) -> tuple[Reading, list[str]]:
    """The reading, and every assumption in words."""
    robot_formats = [said.rotation] if said.rotation else formats_of(robot)
    robot_unit = said.unit or unit_of(robot)
    told = [_length_words("robot", robot, robot_unit, said.unit)]
    if camera is None or camera.turn == "none" or robot.turn == "none":
        mount = said.mount or Mount.EYE_TO_HAND
        usual = Reading(mount, robot_formats[0], robot_unit, None, None, robot.inverted)
        told += [_mount_words(said), *_format_words("robot", robot, robot_formats, said.rotation)]
        return usual, told
    camera_formats = [said.camera_rotation] if said.camera_rotation else formats_of(camera)
    camera_unit = said.camera_unit or unit_of(camera)
    told.append(_length_words("camera", camera, camera_unit, said.camera_unit))
    fits = _fits(robot, camera, robot_formats, camera_formats, (robot_unit, camera_unit), said)
    best, note = _best(fits, said)
    told += [
        *_format_words("robot", robot, [best.robot_format], said.rotation, note),
        *_format_words("camera", camera, [str(best.camera_format)], said.camera_rotation, note),
    ]
    if said.mount is not None:
        told.append(f"mount = {best.mount}: as --as says")
    else:
        told.append(f"mount = {best.mount}: {note}")
    if best.inverted:
        told.append(
            "the robot's poses are taken as wrist_from_base and written inverted: "
            + ("their name says so" if robot.inverted else note)
        )
    return best, told


def _fits(
    robot: PoseColumns,
    camera: PoseColumns,
    robot_formats: Sequence[str],
    camera_formats: Sequence[str],
    units: tuple[str, str],
    said: Said,
) -> list[tuple[float, float, Reading]]:
    """Misfit (deg, mm) of every reading, the usual one first."""
    fits = []
    mounts = [said.mount] if said.mount else [Mount.EYE_TO_HAND, Mount.EYE_IN_HAND]
    for robot_format, camera_format in product(robot_formats, camera_formats):
        poses = Poses.of(poses_of(robot, robot_format, units[0]))
        seen = Poses.of(poses_of(camera, camera_format, units[1]))
        seen = seen.inverted() if camera.inverted else seen
        turns = [robot.inverted] if said.mount is None else [robot.inverted, not robot.inverted]
        for mount, inverted in product(mounts, turns):
            moves = poses.inverted() if inverted != (mount is Mount.EYE_IN_HAND) else poses
            fit = agreement(moves, seen) if len(poses) >= _ENOUGH else None
            misfit = (np.inf, np.inf) if fit is None else (fit.deg, fit.mm)
            reading = Reading(mount, robot_format, units[0], camera_format, units[1], inverted)
            fits.append((*misfit, reading))
    return fits


def _best(fits: Sequence[tuple[float, float, Reading]], said: Said) -> tuple[Reading, str]:
    """The reading that fits clearly better than the usual one, else the usual one; and why."""
    usual_deg, usual_mm, usual = fits[0]
    if not np.isfinite(usual_mm):
        return usual, f"assumed, {_ENOUGH} samples or more would tell"
    deg, mm, best = min(fits, key=lambda fit: fit[1] + fit[0])
    if best is not usual and mm + deg < _CLEARLY * (usual_mm + usual_deg):
        return best, f"so the samples agree to {deg:.2g} deg, {mm:.2g} mm"
    del said
    others = [fit[1] for fit in fits[1:]]
    rival = f" (otherwise {min(others):.2g} mm)" if others else ""
    return usual, f"so the samples agree to {usual_deg:.2g} deg, {usual_mm:.2g} mm{rival}"


def _mount_words(said: Said) -> str:
    if said.mount is not None:
        return f"mount = {said.mount}: as --as says"
    return (
        f"mount = {Mount.EYE_TO_HAND}: assumed, nothing tells it; "
        f"--as mount={Mount.EYE_IN_HAND} where the camera is on the arm"
    )


def _length_words(side: str, group: PoseColumns, unit: str, said: str | None) -> str:
    places = group.rows[:, 3::4] if group.turn == MATRIX else group.rows[:, :3]
    why = f"coordinates reach {np.abs(places).max():.4g}"
    if said:
        why = "as --as says"
    elif group.unit is not None:
        why = "its name says so"
    key = "unit" if side == "robot" else "camera_unit"
    return f"{side}: {group.label}; lengths in {unit}: {why} (--as {key}=...)"


def _format_words(
    side: str, group: PoseColumns, formats: Sequence[str], said: str | None, note: str = ""
) -> list[str]:
    key = "rotation" if side == "robot" else "camera_rotation"
    if formats[0] == "none":
        return [f"{side}: {group.label} hold places, no rotation"]
    if said:
        return [f"{side}: rotation = {formats[0]}: as --as says"]
    certain = formats_of(group)
    if len(certain) == 1:
        return [f"{side}: rotation = {formats[0]}: by names and sizes (--as {key}=...)"]
    why = note or f"assumed, it may be {' or '.join(map(str, certain[1:]))} too"
    return [f"{side}: rotation = {formats[0]}: {why} (--as {key}=...)"]
