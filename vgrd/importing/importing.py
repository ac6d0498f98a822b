"""Files in, a DATASET.toml out, with everything that was assumed."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vgrd.documents.text import brief
from vgrd.documents.toml import hint
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.pose_formats import MATRIX, POSE_FORMATS
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.importing.columns import PoseColumns, pose_columns, words_in
from vgrd.importing.dataset_text import DatasetParts, dataset_text
from vgrd.importing.readings import Reading, Said, places_of, poses_of, read, unit_of
from vgrd.importing.sources import Sources, look_at
from vgrd.model import Mount
from vgrd.vision.images.pictures import SUFFIXES, read_picture
from vgrd.vision.intrinsics.camera_files import size_in

SAID = ("mount", "rotation", "unit", "camera_rotation", "camera_unit", "camera_name")
_KEYS: Mapping[str, tuple[str, ...]] = {
    "mount": tuple(Mount),
    "rotation": POSE_FORMATS,
    "unit": ("mm", "m"),
    "camera_rotation": POSE_FORMATS,
    "camera_unit": ("mm", "m"),
}


@dataclass(frozen=True, slots=True)
class Imported:
    """text: of the dataset; told: what each file was taken for, then every assumption."""

    text: str
    told: tuple[str, ...]
    kind: str
    count: int


def import_files(paths: Sequence[Path], said: Mapping[str, str], folder: Path) -> Imported:
    """The dataset that the files make, for a file in `folder`; said: --as KEY=VALUE.

    Raises InputError for files that are of no use, by what they are, and where poses are missing.
    """
    wishes = _said(said)
    sources = look_at(paths, said.get("camera_name"))
    try:
        return _imported(sources, wishes, said.get("camera_name"), folder)
    except InputError as error:
        names = ", ".join(str(path) for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
        raise InputError(f"{names}: {brief(str(error))}") from error


def _imported(sources: Sources, wishes: Said, camera_name: str | None, folder: Path) -> Imported:
    robot, camera, told = _sides(sources)
    if len(robot.rows) < 3:
        raise InputError(f"{len(robot.rows)} samples are there, at least 3 are needed")
    reading, assumed = read(robot, camera, wishes)
    seen, kind, more = _seen(sources, robot, camera, reading, folder)
    count, size = len(robot.rows), None
    more += _unused(sources, count)
    if kind == "image":
        more += _missing(sources)
        size = _size_of_pictures(sources, camera_name, folder / str(seen[0][1]))
    elif sources.pictures:
        more.append(
            f"{len(sources.pictures)} pictures: not used, what the camera saw is told already"
        )
    parts = DatasetParts(
        mount=reading.mount,
        poses=_written(robot, reading.robot_format, reading.robot_unit, inverted=reading.inverted),
        camera_poses=_camera_poses(camera, reading),
        camera_unit=None if kind != "point_in_camera" or camera is None else unit_of(camera),
        camera=_relative(sources.camera, folder),
        camera_name=camera_name,
        camera_size=size,
        target=sources.board,
        names=_names(sources, count),
        seen=seen,
    )
    everything = (*sources.told, *told, *assumed, *more)
    return Imported(dataset_text(parts, everything), everything, kind, count)


def _camera_poses(camera: PoseColumns | None, reading: Reading) -> tuple[str, str] | None:
    """Unit and format of the camera's poses as they are written."""
    if reading.camera_format is None or camera is None:
        return None
    return str(reading.camera_unit), MATRIX if camera.inverted else str(reading.camera_format)


def _said(words: Mapping[str, str]) -> Said:
    for key, value in words.items():
        if key not in SAID:
            raise InputError(f"--as {key}={value}: '{key}' is unknown{hint(key, SAID)}")
        if key in _KEYS and value not in _KEYS[key]:
            raise InputError(f"--as {key}={value}: '{value}' is unknown{hint(value, _KEYS[key])}")
    mount = words.get("mount")
    return Said(
        mount=None if mount is None else Mount(mount),
        rotation=words.get("rotation"),
        unit=words.get("unit"),
        camera_rotation=words.get("camera_rotation"),
        camera_unit=words.get("camera_unit"),
    )


def _sides(sources: Sources) -> tuple[PoseColumns, PoseColumns | None, list[str]]:
    """The robot's columns and the camera's."""
    groups = [group for _, sheet in sources.sheets for group in pose_columns(sheet)]
    if not groups:
        columns = [name for _, sheet in sources.sheets for name in sheet.columns]
        has = f"; columns: {', '.join(columns[:12])}" if columns else ""
        if columns and all(name.isdecimal() for name in columns):
            has = f"; its {len(columns)} columns have no names: begin with a line such as x,y,z,qx,qy,qz,qw"
        raise InputError(
            "no poses of the robot are there: a table with x, y, z and a rotation, or matrices, is "
            f"needed{has}"
        )
    counts = sorted({len(group.rows) for group in groups})
    if len(counts) > 1:
        raise InputError(
            "the tables have "
            + " and ".join(map(str, counts))
            + " samples: which belongs to which? Remove what has no partner"
        )
    robots = [group for group in groups if group.side == "robot"]
    cameras = [group for group in groups if group.side == "camera"]
    unknown = [group for group in groups if group.side is None]
    told = []
    if not robots and unknown:
        robots = [unknown.pop(0)]
        if cameras or unknown:
            told.append(f"{robots[0].label}: taken for the flange in the base, as it comes first")
    if not cameras and unknown:
        cameras = [unknown.pop(0)]
        told.append(f"{cameras[0].label}: taken for the target in the camera, as it comes second")
    if not robots:
        raise InputError(
            f"{cameras[0].label}: only the camera's side is there, poses of the flange are needed"
        )
    told += [f"{group.label}: not used" for group in (*robots[1:], *cameras[1:], *unknown)]
    return robots[0], cameras[0] if cameras else None, told


def _seen(
    sources: Sources,
    robot: PoseColumns,
    camera: PoseColumns | None,
    reading: Reading,
    folder: Path,
) -> tuple[list[tuple[str, object]], str, list[str]]:
    """What the camera saw in each sample, as key and value; the kind, and assumptions."""
    count = len(robot.rows)
    if camera is not None and (camera.turn == "none" or robot.turn == "none"):
        places = camera.rows[:, 3::4] if camera.turn == MATRIX else camera.rows[:, :3]
        told = [
            f"camera: {camera.label}: the flange's centre, or a ball there, as a 3D camera saw it; where "
            "it is another point of the tool, set tcp_in_wrist"
        ]
        if robot.turn == "none":
            told.append(f"robot: {robot.label}: the wrist is taken as never turned")
        return (
            [("point_in_camera", list(map(float, row))) for row in places],
            "point_in_camera",
            told,
        )
    if camera is not None:
        values = _camera_values(camera, reading)
        told = (
            ["the camera's poses are written inverted: their name says so"]
            if camera.inverted
            else []
        )
        return [("camera_from_target", row) for row in values], "camera_from_target", told
    names, told = _pictures(sources, count)
    return [("image", str(_relative(name, folder))) for name in names], "image", told


def _camera_values(camera: PoseColumns, reading: Reading) -> list[list[float]]:
    if not camera.inverted:
        return [[float(x) for x in row] for row in camera.rows]
    poses = poses_of(camera, str(reading.camera_format), str(reading.camera_unit))
    return [_matrix_values(pose.inverse(), str(reading.camera_unit)) for pose in poses]


def _matrix_values(pose: Pose, unit: str) -> list[float]:
    matrix = pose.matrix()[:3]
    matrix[:, 3] /= 1000.0 if unit == "m" else 1.0
    return [float(x) for x in matrix.ravel()]


def _written(
    robot: PoseColumns, fmt: str, unit: str, *, inverted: bool
) -> tuple[str, str, list[list[float]]]:
    """Unit, format and numbers of the flange's poses, as they were written where they can be."""
    if fmt == "none":
        places = places_of(robot, unit) / (1000.0 if unit == "m" else 1.0)
        return (
            unit,
            RotationFormat.ROTVEC,
            [[*map(float, place), 0.0, 0.0, 0.0] for place in places],
        )
    if not inverted:
        poses_of(robot, fmt, unit)
        return unit, fmt, [[float(x) for x in row] for row in robot.rows]
    values = []
    for pose in poses_of(robot, fmt, unit):
        back = pose.inverse()
        if fmt == MATRIX:
            values.append(_matrix_values(back, unit))
        else:
            turn = rotation_to(back.rotation, RotationFormat(fmt))
            place = back.translation / (1000.0 if unit == "m" else 1.0)
            values.append([float(x) for x in (*place, *turn)])
    return unit, fmt, values


def _pictures(sources: Sources, count: int) -> tuple[list[Path], list[str]]:
    """A picture for each sample: by a column of names, else in natural order."""
    for path, sheet in sources.sheets:
        base = path if path.is_dir() else path.parent
        for name, words in words_in(sheet).items():
            if all(Path(word).suffix.lower() in SUFFIXES for word in words):
                by_name = {picture.name: picture for picture in sources.pictures}
                named = [by_name.get(Path(word).name, base / word) for word in words]
                return named, [f"pictures: by column '{name}'"]
    if not sources.pictures:
        raise InputError(
            "only poses of the robot are there: name the pictures too, or poses of the target in the camera"
        )
    if len(sources.pictures) != count:
        raise InputError(
            f"{len(sources.pictures)} pictures for {count} poses: which belongs to which? Remove what "
            "has no partner"
        )
    for _, sheet in sources.sheets:
        stems = {picture.stem: picture for picture in sources.pictures}
        for name, words in words_in(sheet).items():
            if all(Path(word).stem in stems for word in words):
                return [stems[Path(word).stem] for word in words], [
                    f"pictures: by column '{name}'"
                ]
    told = [
        f"pictures: in natural order, {sources.pictures[0].name} belongs to the first pose, "
        f"{sources.pictures[-1].name} to the last"
    ]
    return sources.pictures, told


def _names(sources: Sources, count: int) -> list[str]:
    for _, sheet in sources.sheets:
        for name, words in words_in(sheet).items():
            if "name" in name.lower() and len(set(words)) == count:
                return list(words)
    return [str(number) for number in range(count)]


def _relative(path: Path | None, folder: Path) -> str | None:
    if path is None:
        return None
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return str(path.resolve())


def _unused(sources: Sources, count: int) -> list[str]:
    """Files that were read and of which nothing is written."""
    return [
        f"{path}: not used, it holds no poses"
        for path, sheet in sources.sheets
        if not pose_columns(sheet) and (len(sheet) != count or not words_in(sheet))
    ]


def _missing(sources: Sources) -> list[str]:
    """What a dataset of pictures needs beside poses, with how to give it."""
    lacking = []
    if sources.board is None:
        lacking.append(
            "still missing: the target; name a board file or Kalibr's target file too, or add [target] with "
            "its type and sizes to the dataset"
        )
    if sources.camera is None:
        lacking.append(
            "still missing: the camera; name its camera file too, or add [camera] with matrix = "
            "[fx, fy, cx, cy] and distortion to the dataset"
        )
    return lacking


def _size_of_pictures(
    sources: Sources, camera_name: str | None, picture: Path
) -> list[int] | None:
    """Width and height of the pictures, where the camera file tells none."""
    if sources.camera is None or size_in(sources.camera, camera_name) is not None:
        return None
    if not picture.is_file():
        return None
    height, width = read_picture(picture).pixels.shape
    return [width, height]
