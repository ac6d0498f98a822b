"""Camera files as plain nested tables, whatever their format: TOML, YAML, JSON, NPZ, OpenCV's storage."""

import io
import json
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from vgrd.documents.text import decoded, read_bytes
from vgrd.errors import InputError

Document = Mapping[str, Any]
_DEEPEST = 12  # tables in tables; a guess: a camera file has three
_MOST_VALUES = 1_000_000  # a guess: OpenCV's sample writes all image points, some 10,000
_SLOW_YAML = 1_000_000  # characters; a guess: its reader takes 10 s for as many, a camera has 1000


def read_document(path: Path) -> Document:
    """The file as nested tables; InputError, without the file's name, says why it is none."""
    data = read_bytes(path)
    if not data.strip():
        raise InputError("is empty: name a camera file")
    if data.startswith(b"PK\x03\x04"):
        return _npz(data)
    text = decoded(data).lstrip()
    try:
        found = _parsed(text, path.suffix.lower())
    except (ValueError, yaml.YAMLError, cv2.error, SystemError) as error:
        reason = str(error).splitlines() or ["unreadable"]
        raise InputError(f"not valid: {' '.join(reason[:3])[:200]}") from error
    except RecursionError as error:
        raise InputError("not valid: nested too deeply") from error
    if not isinstance(found, Mapping):
        raise InputError(
            "holds no camera: it is no file of OpenCV, ROS, Kalibr, RealSense, Open3D, Zivid, "
            "NPZ, and no TOML of ours"
        )
    _check_size(found)
    return found


def read_storage(text: str) -> Document | None:
    """A file of OpenCV's FileStorage as nested tables, matrices as lists of rows; None for other text.

    Raises InputError where OpenCV cannot read it.
    """
    if not (text.startswith("%YAML:") or "<opencv_storage" in text[:1000]):
        return None
    try:
        found = _storage(text)
    except (cv2.error, SystemError) as error:
        raise InputError(f"not valid: {str(error).splitlines()[0][:200]}") from error
    return found if isinstance(found, Mapping) else {}


def _parsed(text: str, suffix: str) -> object:
    if suffix == ".toml":
        return tomllib.loads(text)
    if text.startswith("%YAML:") or "<opencv_storage" in text[:1000]:
        return _storage(text)
    if text.startswith(("<?xml", "<")):
        raise InputError(f"is XML of another program ({_root_element(text)}), not OpenCV's")
    if text.startswith("{"):
        try:
            return json.loads(text)
        except json.JSONDecodeError as error:
            if ":" in text and suffix == ".json" and '"' in text:
                try:
                    return _storage(text)  # OpenCV writes 1. for 1.0
                except (cv2.error, SystemError, InputError):
                    pass
            raise error from None
    if len(text) > _SLOW_YAML:
        raise InputError(f"has {len(text)} characters: is it a camera file?")
    return _yaml(text)


def _yaml(text: str) -> object:
    """The one document of the text; `ros topic echo` ends each message with three dashes."""
    documents = [data for data in yaml.safe_load_all(text) if data is not None]
    cameras = [_without_time(data) for data in documents]
    if any(other != cameras[0] for other in cameras[1:]):
        raise InputError(f"holds {len(documents)} messages that differ: keep one of them")
    return documents[0] if documents else None


def _without_time(data: object) -> object:
    if not isinstance(data, Mapping):
        return data
    return {key: value for key, value in data.items() if key != "header"}


def _storage(text: str) -> object:
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    return _plain(storage.root(), _DEEPEST)


def _plain(node: cv2.FileNode, depth: int) -> object:
    """A node of OpenCV's storage as plain values; a matrix is a table with rows, cols, data."""
    if depth == 0:
        raise InputError("not valid: nested too deeply")
    if node.isMap():
        return {key: _plain(node.getNode(key), depth - 1) for key in node.keys()}  # noqa: SIM118 (a FileNode does not iterate)
    if node.isSeq():
        return [_plain(node.at(index), depth - 1) for index in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _npz(data: bytes) -> Document:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name].tolist() for name in archive.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(
            f"is a ZIP archive but no NPZ of plain numbers ({str(error).splitlines()[0][:100]})"
        ) from error


def _root_element(text: str) -> str:
    start = text.find("<", text.find("?>") + 1) if text.startswith("<?") else 0
    return text[start : start + 40].split(">")[0].split()[0] + ">"


def _check_size(document: Document) -> None:
    """Refuse tables in tables without end, as an alias of YAML makes them, and what would take hours."""
    level: list[object] = [document]
    count = 0
    for _ in range(_DEEPEST):
        count += len(level)
        if count > _MOST_VALUES:
            raise InputError(f"holds more than {_MOST_VALUES} values: is it a camera file?")
        level = [
            inner
            for value in level
            if isinstance(value, Mapping | list)
            for inner in (value.values() if isinstance(value, Mapping) else value)
        ]
        if not level:
            return
    raise InputError("not valid: nested too deeply")
