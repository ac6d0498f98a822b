"""Intrinsics in files: OpenCV's YAML, XML and JSON, ROS camera_info, Kalibr, and our own TOML.

Whatever the format, keys are compared without case and underscores, so that `camera_matrix`,
`cameraMatrix` and `Camera_Matrix` are one. Focal lengths, principal point and size in px.
"""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import yaml
from scipy.optimize import least_squares

from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel

_MATRIX = ("cameramatrix", "k", "matrix", "intrinsicmatrix", "intrinsics", "m1")
_DISTORTION = (
    *("distortioncoefficients", "distcoeffs", "distortion", "distortioncoeffs"),
    *("distcoefficients", "dist", "d", "d1"),
)
_SIZES = ("imagesize", "sizepx", "resolution", "size")
_PINHOLE = ("plumbbob", "rationalpolynomial", "radtan", "thinprism", "opencv", "none", "")
_LENGTHS = (0, 4, 5, 8, 12, 14)  # what OpenCV knows
_OURS = 8  # the most that `CameraModel` takes: without thin prism and tilt
_SAME_PX = 0.02  # by which another model may differ: OpenCV's corners of boards err more
Kind = Literal["opencv", "ros", "toml"]
Document = Mapping[str, Any]


def read_camera(path: Path, size_px: tuple[int, int] | None = None) -> CameraModel:
    """Intrinsics of one camera; size_px (width, height) is used where the file tells none.

    Distortion with 12 or 14 numbers is expressed with 8. Raises InputError naming the file and
    what is wrong: not readable, several cameras, a fisheye model, no size.
    """
    try:
        return _camera(_table(_document(path)), size_px)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_camera(path: Path, camera: CameraModel, kind: Kind, name: str = "camera") -> None:
    """Write the camera; kind "opencv" follows the suffix (.yaml, .yml, .xml, .json)."""
    match kind:
        case "ros":
            text = ros_yaml(camera, name)
        case "toml":
            text = camera_toml(camera)
        case "opencv":
            text = opencv_text(camera, path.suffix.lower())
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def camera_json(camera: CameraModel) -> dict[str, object]:
    """The camera as JSON: matrix fx, fy, cx, cy in px, distortion, size_px (width, height)."""
    K = camera.matrix
    return {
        "matrix": [float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])],
        "distortion": camera.distortion.tolist(),
        "size_px": list(camera.size_px),
    }


def camera_toml(camera: CameraModel) -> str:
    """The [camera] keys of the cell file; those of the driver are not among them."""
    K = camera.matrix
    return (
        "[camera]\n"
        f"matrix = {_numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])}   # fx fy cx cy, px\n"
        f"distortion = {_numbers(camera.distortion)}\n"
        f"size_px = [{camera.size_px[0]}, {camera.size_px[1]}]\n"
    )


def ros_yaml(camera: CameraModel, name: str = "camera") -> str:
    """ROS camera_info, as camera_calibration_parsers reads it."""
    distortion = camera.distortion if camera.distortion.size else np.zeros(5)
    if distortion.size < 5:
        distortion = np.append(distortion, 0.0)
    model = "plumb_bob" if distortion.size == 5 else "rational_polynomial"
    projection = np.hstack([camera.matrix, np.zeros((3, 1))])
    blocks = {
        "camera_matrix": camera.matrix,
        "distortion_coefficients": distortion[None],
        "rectification_matrix": np.eye(3),
        "projection_matrix": projection,
    }
    lines = [
        f"image_width: {camera.size_px[0]}",
        f"image_height: {camera.size_px[1]}",
        f"camera_name: {name}",
        f"distortion_model: {model}",
    ]
    for key, values in blocks.items():
        rows, columns = values.shape
        lines += [f"{key}:", f"  rows: {rows}", f"  cols: {columns}"]
        lines.append(f"  data: {_numbers(values)}")
    return "\n".join([*lines, ""])


def opencv_text(camera: CameraModel, suffix: str) -> str:
    """OpenCV's FileStorage as its calibration sample writes it; suffix .yaml, .yml, .xml or .json."""
    if suffix not in (".yaml", ".yml", ".xml", ".json"):
        raise InputError(f"OpenCV knows no files *{suffix}: use .yaml, .xml or .json")
    storage = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.size_px[0])
    storage.write("image_height", camera.size_px[1])
    storage.write("camera_matrix", camera.matrix)
    distortion = camera.distortion if camera.distortion.size else np.zeros(5)
    storage.write("distortion_coefficients", distortion[:, None])
    return str(storage.releaseAndGetString())


def _document(path: Path) -> Document:
    """The file as nested tables, whatever its format."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError("no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}") from error
    start = text.lstrip()[:5]
    try:
        if path.suffix.lower() == ".toml":
            data: object = tomllib.loads(text)
        elif start in ("%YAML", "<?xml") or start[:1] == "{":
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            data = _plain(storage.root())
        else:
            data = yaml.safe_load(text)
    except (tomllib.TOMLDecodeError, yaml.YAMLError, cv2.error, SystemError) as error:
        raise InputError(f"not valid: {str(error).splitlines()[0]}") from error
    if not isinstance(data, Mapping):
        raise InputError("holds no camera: neither OpenCV's, nor ROS camera_info, nor our TOML")
    return data


def _plain(node: cv2.FileNode) -> object:
    """A node of OpenCV's storage as plain values; a matrix is a table with rows, cols, data."""
    if node.isMap():
        return {key: _plain(node.getNode(key)) for key in node.keys()}  # noqa: SIM118 (a FileNode does not iterate)
    if node.isSeq():
        return [_plain(node.at(index)) for index in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _table(document: Document) -> Document:
    """The one table with a camera matrix, its keys made plain."""
    tables = list(_tables(document, ""))
    if not tables:
        raise InputError("holds no camera matrix (camera_matrix, K, or [camera] matrix)")
    if len(tables) > 1:
        names = ", ".join(name or "(top)" for name, _ in tables)
        raise InputError(f"holds several cameras: {names}; give a file with one")
    return tables[0][1]


def _tables(table: Document, name: str) -> Iterator[tuple[str, Document]]:
    plain = {str(key).lower().replace("_", ""): value for key, value in table.items()}
    if any(key in plain for key in _MATRIX):
        yield name, plain
        return
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _tables(value, f"{name}.{key}".lstrip("."))


def _camera(table: Document, size_px: tuple[int, int] | None) -> CameraModel:
    _refuse_fisheye(table)
    numbers = next((table[key] for key in _DISTORTION if key in table), None)
    distortion = np.zeros(0) if numbers is None else _values(numbers, "distortion").ravel()
    if distortion.size not in _LENGTHS:
        raise InputError(
            f"distortion has {distortion.size} numbers, OpenCV knows "
            + ", ".join(map(str, _LENGTHS))
        )
    size = _size(table) or size_px
    if size is None:
        raise InputError("does not tell the picture's size: add image_width and image_height")
    matrix = _matrix(next(table[key] for key in _MATRIX if key in table))
    if distortion.size > _OURS and not distortion[_OURS:].any():
        distortion = distortion[:_OURS]
    if distortion.size > _OURS:
        return _expressed(matrix, distortion, size)
    return CameraModel(matrix, distortion, size)


def _refuse_fisheye(table: Document) -> None:
    model = str(table.get("distortionmodel", "")).lower().replace("_", "")
    flag = table.get("fisheyemodel", 0)
    if flag in (1, 1.0, True, "1") or (model and model not in _PINHOLE):
        name = table.get("distortionmodel", "fisheye")
        raise InputError(
            f"distortion model {name!r} is not known here: a pinhole camera with OpenCV's "
            "plumb_bob or rational_polynomial is needed; calibrate anew with vgrd intrinsics"
        )


def _matrix(value: object) -> Array:
    if isinstance(value, Mapping) and {"fx", "fy", "cx", "cy"} <= value.keys():
        value = [value[key] for key in ("fx", "fy", "cx", "cy")]
    numbers = _values(value, "camera matrix").ravel()
    if numbers.size == 4:
        fx, fy, cx, cy = numbers
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if numbers.size != 9:
        raise InputError(
            f"the camera matrix has {numbers.size} numbers, 9 or fx fy cx cy are needed"
        )
    return numbers.reshape(3, 3)


def _size(table: Document) -> tuple[int, int] | None:
    for width, height in (("imagewidth", "imageheight"), ("width", "height")):
        if width in table and height in table:
            return _whole([table[width], table[height]])
    return next((_whole(table[key]) for key in _SIZES if key in table), None)


def _whole(value: object) -> tuple[int, int]:
    numbers = _values(value, "picture size").ravel()
    if numbers.size != 2 or (numbers < 1).any() or (numbers % 1).any():
        raise InputError(f"picture size {value!r}: two whole numbers are needed, width and height")
    return int(numbers[0]), int(numbers[1])


def _values(value: object, key: str) -> Array:
    data = value.get("data") if isinstance(value, Mapping) else value
    try:
        numbers = np.array(data, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{key} {data!r}: numbers are needed") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{key} {data!r}: finite numbers are needed")
    return numbers


def _expressed(matrix: Array, distortion: Array, size: tuple[int, int]) -> CameraModel:
    """The same camera with eight distortion numbers: thin prisms and tilted sensors are no others here.

    Fitted to rays over the whole picture; InputError where that leaves more than 0.02 px.
    """
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 21), np.linspace(0, size[1] - 1, 17))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    rays = cv2.undistortPointsIter(pixels, matrix, distortion, np.eye(3), np.eye(3), criteria)
    points = np.hstack([rays.reshape(-1, 2), np.ones((len(pixels), 1))])

    def camera(x: Array) -> CameraModel:
        K = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1]])
        return CameraModel(K, x[4:], size)

    def residuals(x: Array) -> Array:
        return np.asarray((camera(x).project(points) - pixels).ravel())

    start = np.append(matrix[[0, 1, 0, 1], [0, 1, 2, 2]], distortion[:_OURS])
    minimum = least_squares(residuals, start, x_scale="jac")
    worst = float(np.abs(minimum.fun).max())
    if not worst < _SAME_PX:
        raise InputError(
            f"its thin prism or tilt distortion cannot be expressed with 8 numbers ({worst:.2g} px "
            "off): calibrate anew with vgrd intrinsics"
        )
    return camera(minimum.x)


def _numbers(values: object) -> str:
    return "[" + ", ".join(repr(float(x)) for x in np.ravel(np.asarray(values))) + "]"
