"""Which keys of a camera file mean what: every key is understood, or the file is refused with its name.

Keys are compared without case and signs, so that `camera_matrix`, `cameraMatrix` and `Camera-Matrix` are
one. A camera is a table with a matrix, or with fx and fy; what its outer tables say of lens and size
holds for it too.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vgrd.errors import InputError

_WHICH = r"_?(?P<which>1|2|l|r|left|right)?"  # M1, M2 of OpenCV's stereo sample, and its likes
_MATRIX = re.compile(
    r"(k|m|mtx|matrix|(cam|camera)(matrix|mtx|mat|intrinsics?)|kmatrix|matrixk|intrinsics?|"
    r"intrinsics?(matrix|mtx|parameters?|params?)|projectionparameters)" + _WHICH
)
_DISTORTION = re.compile(
    r"((lens|cam|camera)?(dist|distortion)s?(coefs?|coeffs?|coefficients?|params?|parameters?|"
    r"vector|vec|values)?|d|coeffs|kc)" + _WHICH
)
_MODEL = re.compile(
    r"((dist|distortion|camera|lens|projection)?model(type)?|distortiontype|(is)?fisheye(model)?)"
)
_SIZE = re.compile(r"(image|picture|img|frame)?(size|resolution|dimensions?)(px|pixels?)?")
_WIDTH = re.compile(r"(image|picture|img|frame)?(width|w)(px)?")
_HEIGHT = re.compile(r"(image|picture|img|frame)?(height|h)(px)?")
NUMBERED = (  # OpenCV's order
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "taux", "tauy"),
)
FOCAL = frozenset(("fx", "fy", "cx", "cy", "ppx", "ppy"))
_LENS = re.compile(
    r"dist(?!ance)|coef|fisheye|lensparam|radial|tangential|^xi$|^omega$|^[kps]\d+$|^tau[xy]$"
)
_OTHER_LENS = re.compile(
    r"fish|kannala|equidist|omni|mei|scaramuzza|^fov|atan|eucm|ucm$|^ds|sphere"
)
_HARMLESS = re.compile(  # by which a key tells of something else than the lens
    r"^([rptefq]|rms|ret|fps|bf|rgb|id|uid|type|units?|class|which|skew)$|error|time|date|stamp|name|"
    r"board|square|pattern|corner|flags?|topic|overlap|serial|vendor|version|comment|note|author|"
    r"description|header|rectif|projectionmatrix|newcamera|optimal|extrinsic|rvec|tvec|rotation|"
    r"translation|^t(cn|cam|body|ci|ic|bs)|timeshift|roi|binning|fov|points?|views?|count|^num|^nr|^nf|"
    r"pixelsize|sensor|exposure|gain|aspect|grid|marker|calib|frames?|lensposition|cameratype|"
    r"^info|source|depth|baseline|stereo|^ros|std|sigma|covariance|file|path|scale|host|rate|focal|index|id$|port$|gamma|iso$|"
    r"temperature|quality|threshold|success|valid|user|revision|mean|median|maximum|minimum|model$"
)


@dataclass(frozen=True, slots=True, eq=False)
class CameraTable:
    """One camera of a file by what its keys mean, values unread; distortion None where it tells none.

    name: in the file, "" at the top; matrix_key, distortion_key: as written there; models: by key; size:
    (width, height) or one value; more: keys of binning and region as they are.
    """

    name: str
    matrix: object
    matrix_key: str
    distortion: object | None
    distortion_key: str
    models: Mapping[str, object]
    size: object | None
    more: Mapping[str, object]


def plain(key: object) -> str:
    """A key without case and signs."""
    return re.sub(r"[^a-z0-9]", "", str(key).lower())


def cameras_in(document: Mapping[str, Any], *, strict: bool) -> list[CameraTable]:
    """Every camera of the document; strict: no key of a camera's table may be unknown.

    Raises InputError naming the key that is not understood.
    """
    cameras: list[CameraTable] = []
    orphans: list[str] = []
    _walk(_nested(document), "", {}, strict, cameras, orphans)
    if cameras and orphans:
        raise _not_understood(orphans[0])
    return cameras


def _walk(
    table: Mapping[str, Any],
    path: str,
    outer: Mapping[str, Any],
    strict: bool,
    cameras: list[CameraTable],
    orphans: list[str],
) -> None:
    if _is_camera(table):
        cameras += _cameras_of(table, path, outer, strict=strict)
        return
    roles = {key: value for key, value in table.items() if _is_role(plain(key), value)}
    inner = {name: value for name, value in _children(table) if name not in roles}
    if any(_holds_camera(value) for value in inner.values()):
        outer = {**outer, **roles}
    else:
        orphans += [f"{path}.{key}".lstrip(".") for key in roles if _tells_lens(key, roles[key])]
    for name, value in inner.items():
        _walk(value, f"{path}.{name}".lstrip("."), outer, strict, cameras, orphans)


def _cameras_of(
    table: Mapping[str, Any], path: str, outer: Mapping[str, Any], *, strict: bool
) -> Iterator[CameraTable]:
    """The cameras of one table: one, or those that a stereo file tells apart by an ending."""
    merged = {**outer, **table}
    whole = {key: value for key, value in merged.items() if _is_matrix(plain(key), value)}
    endings = {_ending(_MATRIX, key): key for key in whole} or {"": ""}
    for ending, matrix_key in endings.items():
        one = {
            key: value
            for key, value in merged.items()
            if not (
                (_ending(_DISTORTION, key) not in ("", ending) and _is_numbers(value))
                or (key in whole and key != matrix_key)
            )
        }
        name = f"{path}.{matrix_key}".lstrip(".") if len(endings) > 1 else path
        yield _camera_of(one, name, matrix_key, strict=strict)


def _camera_of(
    table: Mapping[str, Any], name: str, matrix_key: str, *, strict: bool
) -> CameraTable:
    left = {key: value for key, value in table.items() if value is not None}
    focal = {plain(key): left.pop(key) for key in list(left) if plain(key) in FOCAL}
    matrix = left.pop(matrix_key) if matrix_key else focal
    key = next((k for k in left if _DISTORTION.fullmatch(plain(k)) and _is_numbers(left[k])), "")
    numbered = {plain(k): left.pop(k) for k in list(left) if _is_numbered(plain(k), left[k])}
    if key and numbered:
        raise InputError(f"tells its distortion twice: {key} and {', '.join(numbered)}; keep one")
    distortion = left.pop(key) if key else numbered or None
    models = {k: left.pop(k) for k in list(left) if _MODEL.fullmatch(plain(k))}
    models |= {k: v for k, v in left.items() if plain(k) == "type" and _is_other_lens(v)}
    sizes = [_taken(left, pattern) for pattern in (_WIDTH, _HEIGHT, _SIZE)]
    size = sizes[:2] if None not in sizes[:2] else sizes[2]
    more = {plain(k): v for k, v in left.items()}
    for unknown in left:
        word = plain(unknown)
        if isinstance(left[unknown], str | bool) and not _tells_lens(unknown, left[unknown]):
            continue  # words tell no numbers
        if (_LENS.search(word) and not _is_harmless(word)) or (strict and not _is_harmless(word)):
            raise _not_understood(f"{name}.{unknown}".lstrip("."))
    return CameraTable(name, matrix, matrix_key or "fx", distortion, key, models, size, more)


def _taken(table: dict[str, Any], pattern: re.Pattern[str]) -> object | None:
    key = next((key for key in table if pattern.fullmatch(plain(key))), None)
    return None if key is None else table.pop(key)


def _not_understood(key: str) -> InputError:
    return InputError(
        f"key '{key}' is not understood, and the file is not read in part: if it holds OpenCV's "
        "numbers k1 k2 p1 p2 k3 ... call it distortion_coefficients, if it says nothing of the lens "
        "remove it"
    )


def _nested(table: Mapping[str, Any]) -> dict[str, Any]:
    """Keys with dots, as ORB-SLAM writes `Camera.fx`, as tables in tables."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        first, dot, rest = str(key).partition(".")
        if dot and first and rest and not isinstance(value, Mapping):
            inner = out.setdefault(first, {})
            if isinstance(inner, dict):
                inner[rest] = value
        else:
            out[str(key)] = value
    return out


def _children(table: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Tables in a table; also those in lists, by their place."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield str(key), value
        elif isinstance(value, list):
            entries = {str(i): entry for i, entry in enumerate(value)}
            if any(isinstance(entry, Mapping | list) for entry in entries.values()):
                yield str(key), entries


def _is_camera(table: Mapping[str, Any]) -> bool:
    keys = {plain(key) for key in table}
    return {"fx", "fy"} <= keys or any(_is_matrix(plain(k), v) for k, v in table.items())


def _holds_camera(table: Mapping[str, Any]) -> bool:
    return _is_camera(table) or any(_holds_camera(value) for _, value in _children(table))


def _is_matrix(key: str, value: object) -> bool:
    if not _MATRIX.fullmatch(key) or _is_numbered(key, value):
        return False
    if isinstance(value, Mapping) and "data" not in value:
        return {"fx", "fy"} <= {plain(k) for k in value} <= FOCAL | {"skew"}
    return _is_numbers(value)


def _is_numbered(key: str, value: object) -> bool:
    return key in NUMBERED and isinstance(value, int | float | str)


def _is_numbers(value: object) -> bool:
    """A list of numbers, a matrix of OpenCV or ROS, or numbers by name."""
    return isinstance(value, list | Mapping)


def _is_role(key: str, value: object) -> bool:
    return _tells_lens(key, value) or any(
        pattern.fullmatch(key) for pattern in (_MODEL, _SIZE, _WIDTH, _HEIGHT)
    )


def _tells_lens(key: str, value: object) -> bool:
    word = plain(key)
    if word in ("type", "cameratype") or _MODEL.fullmatch(word):
        return _is_other_lens(value)
    if not _LENS.search(word) or _is_harmless(word):
        return False
    return not (isinstance(value, Mapping) and _holds_camera(value))


def _is_other_lens(value: object) -> bool:
    return isinstance(value, str) and bool(_OTHER_LENS.search(plain(value)))


def _is_harmless(key: str) -> bool:
    return bool(_HARMLESS.search(key)) and not (_LENS.search(key) and "error" not in key)


def _ending(pattern: re.Pattern[str], key: str) -> str:
    found = pattern.fullmatch(plain(key))
    return (found.group("which") or "") if found else ""
