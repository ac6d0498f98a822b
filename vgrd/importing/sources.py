"""What each file is that a user names: a camera, a board, pictures, a table; others are refused by what they are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vgrd.documents.natural_order import natural_order
from vgrd.documents.sheets import Sheet, from_nested, read_sheet
from vgrd.documents.text import binary_kind, decoded, read_bytes
from vgrd.documents.toml import read_toml
from vgrd.errors import ConfigError, InputError
from vgrd.importing.columns import pose_columns
from vgrd.importing.kalibr_targets import kalibr_target
from vgrd.importing.robot_programs import program_sheet
from vgrd.vision.images.pictures import SUFFIXES
from vgrd.vision.intrinsics.camera_documents import read_storage
from vgrd.vision.intrinsics.camera_files import read_camera, size_in

_OTHERS = {  # by ending: what it is, and what to bring instead
    ".bag": "a ROS bag: write the poses with `rostopic echo -p TOPIC > poses.csv`",
    ".db3": "a ROS 2 bag: write the poses with `ros2 topic echo --csv TOPIC > poses.csv`",
    ".mcap": "an MCAP recording: write the poses with `ros2 topic echo --csv TOPIC > poses.csv`",
    ".mat": "a MATLAB file: write it with writetable or jsonencode",
    ".xlsx": "a spreadsheet: save it as CSV",
    ".xls": "a spreadsheet: save it as CSV",
    ".ods": "a spreadsheet: save it as CSV",
    ".pkl": "a Python pickle: write it with numpy.savez or json.dump",
    ".pickle": "a Python pickle: write it with numpy.savez or json.dump",
    ".urdf": "a robot description: it holds no samples",
    ".xacro": "a robot description: it holds no samples",
    ".ply": "a cloud of points: name the places of the ball in it, as a table",
    ".pcd": "a cloud of points: name the places of the ball in it, as a table",
    ".stl": "a solid: it holds no samples",
    ".step": "a solid: it holds no samples",
    ".zip": "an archive: unpack it, and name its files",
    ".gz": "an archive: unpack it, and name its files",
    ".pdf": "a document: it holds no samples",
    ".zdf": "Zivid's point cloud: name the places in it, as a table",
    ".mp4": "a film: name its pictures, one for each pose",
    ".avi": "a film: name its pictures, one for each pose",
}


@dataclass(slots=True)
class Sources:
    """What the files hold together; told: what each was taken for."""

    sheets: list[tuple[Path, Sheet]] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)
    camera: Path | None = None
    board: Mapping[str, object] | None = None
    told: list[str] = field(default_factory=list)


def look_at(paths: Sequence[Path], camera_name: str | None = None) -> Sources:
    """Every file recognised; InputError names those that are of no use, all in one message."""
    sources, faults = Sources(), []
    for path in paths:
        try:
            _take(sources, path, camera_name)
        except (InputError, ConfigError) as error:
            faults.append(str(error))
    if faults:
        raise InputError("\n".join(faults))
    return sources


def _take(sources: Sources, path: Path, camera_name: str | None) -> None:
    if path.is_dir():
        _take_folder(sources, path)
        return
    suffix = path.suffix.lower()
    if suffix in _OTHERS:
        _exists(path)
        raise InputError(f"{path}: is {_OTHERS[suffix]}")
    if suffix in SUFFIXES:
        _exists(path)
        sources.pictures.append(path)
        sources.told.append(f"{path}: a picture")
    elif suffix == ".toml":
        _take_toml(sources, path)
    else:
        _take_data(sources, path, camera_name)


def _exists(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path}: no such file")


def _take_folder(sources: Sources, folder: Path) -> None:
    files = [path for path in folder.iterdir() if path.is_file()]
    pictures = {path.name: path for path in files if path.suffix.lower() in SUFFIXES}
    if pictures:
        names = natural_order(pictures)
        sources.pictures += [pictures[name] for name in names]
        sources.told.append(
            f"{folder}: {len(names)} pictures in natural order, {names[0]} to {names[-1]}"
        )
        return
    rows = {
        p.name: p for p in files if p.suffix.lower() in (".yaml", ".yml", ".json", ".txt", ".csv")
    }
    if not rows:
        raise InputError(f"{folder}: holds no pictures and no files with a pose each")
    names = natural_order(rows)
    sheets = [read_sheet(rows[name]) for name in names]
    if any(len(sheet) not in (1, 3, 4) for sheet in sheets):
        raise InputError(f"{folder}: its files hold more than a pose each: name the one to import")
    sources.sheets.append((folder, _stacked(names, sheets)))
    sources.told.append(
        f"{folder}: {len(names)} files with one pose each, {names[0]} to {names[-1]} in natural order"
    )


def _stacked(names: Sequence[str], sheets: Sequence[Sheet]) -> Sheet:
    """One row of each file; three or four rows are a matrix."""
    columns: dict[str, list[object]] = {"name": [Path(name).stem for name in names]}
    for sheet in sheets:
        if len(sheet) > 1:
            cells = zip(*sheet.columns.values(), strict=True)
            columns.setdefault("pose", []).append([list(row) for row in cells])
        else:
            for key, values in sheet.columns.items():
                columns.setdefault(key, []).append(values[0])
    if len({len(values) for values in columns.values()}) != 1:
        raise InputError(f"{names[0]} to {names[-1]}: have other columns than each other")
    return Sheet(columns, list(names))


def _take_toml(sources: Sources, path: Path) -> None:
    data = read_toml(path, "a board file or camera file")
    if "sample" in data or "poses" in data:
        raise InputError(
            f"{path}: is a dataset or a file of touches already: vgrd solve, vgrd tcp"
        )
    if "target" in data or "type" in data:
        table = data.get("target", data)
        if not isinstance(table, dict):
            raise InputError(f"{path}: [target] is needed")
        _take_board(sources, path, table)
    elif "camera" in data:
        read_camera(path)
        _take_camera(sources, path)
    else:
        raise InputError(f"{path}: holds neither [target] nor [camera]")


def _take_data(sources: Sources, path: Path, camera_name: str | None) -> None:
    """A camera file if it is one, else a table; what is neither is told as what it resembles."""
    try:
        data = read_bytes(path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    doubt: InputError | None = None
    if binary_kind(data) is None or data.startswith(b"PK\x03\x04"):
        try:
            size_in(path, camera_name)
        except InputError as error:
            doubt = error if "key '" in str(error) or "several cameras" in str(error) else None
        else:
            _take_camera(sources, path)
            return
    try:
        if _take_words(sources, path, data):
            return
        sheet = _sheet(path, data)
    except InputError as error:
        raise doubt or error from error
    if doubt is not None and not pose_columns(sheet):
        raise doubt
    sources.sheets.append((path, sheet))
    shown = ", ".join(list(sheet.columns)[:8])
    sources.told.append(f"{path}: a table of {len(sheet)} samples, columns {shown}")


def _take_words(sources: Sources, path: Path, data: bytes) -> bool:
    """Whether the file is a target file of Kalibr or a program of a robot; it is taken then."""
    if binary_kind(data) is not None:
        return False
    try:
        text = decoded(data)
        target = kalibr_target(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if target is not None:
        _take_board(sources, path, target)
        return True
    program = program_sheet(text)
    if program is None:
        return False
    kind, sheet = program
    sources.sheets.append((path, sheet))
    sources.told.append(
        f"{path}: {len(sheet)} {kind}; they are of the tool that was active: it has to be the flange"
    )
    return True


def _take_board(sources: Sources, path: Path, table: Mapping[str, object]) -> None:
    if sources.board is not None:
        raise InputError(f"{path}: is a second board: name one")
    sources.board = {key: value for key, value in table.items() if np.isscalar(value)}
    sources.told.append(f"{path}: the board")


def _take_camera(sources: Sources, path: Path) -> None:
    if sources.camera is not None:
        raise InputError(f"{path}: is a second camera beside {sources.camera}: name one")
    sources.camera = path
    sources.told.append(f"{path}: the camera")


def _sheet(path: Path, data: bytes) -> Sheet:
    """The table of a file; those of OpenCV's FileStorage are read by OpenCV."""
    if not binary_kind(data):
        try:
            stored = read_storage(decoded(data).lstrip())
            if stored is not None:
                return from_nested(_with_rows(stored))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    return read_sheet(path)


def _with_rows(value: object) -> object:
    """Matrices of OpenCV as lists of rows."""
    if isinstance(value, Mapping):
        if {"rows", "cols", "data"} <= value.keys():
            rows, columns = int(value["rows"]), int(value["cols"])
            data = list(value["data"])
            return [data[i * columns : (i + 1) * columns] for i in range(rows)]
        return {key: _with_rows(inner) for key, inner in value.items()}
    return [_with_rows(inner) for inner in value] if isinstance(value, list) else value
