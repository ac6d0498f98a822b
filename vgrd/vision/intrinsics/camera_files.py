"""Intrinsics in files: OpenCV, ROS camera_info, Kalibr, RealSense, Open3D, Zivid, NPZ, and our own TOML.

Focal lengths, principal point and size in px.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from vgrd.documents.text import brief
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.camera import CameraModel, implausible_distortion, implausible_matrix
from vgrd.vision.intrinsics.camera_documents import read_document
from vgrd.vision.intrinsics.camera_keys import NUMBERED, CameraTable, cameras_in, plain
from vgrd.vision.intrinsics.lens_models import RAYS, expressed, opencv_rays

_PINHOLE = frozenset(
    (
        *("", "none", "false", "0", "0.0", "standard", "opencv", "pinhole", "perspective"),
        *(
            "plumbbob",
            "rationalpolynomial",
            "thinprism",
            "thinprismmodel",
            "brown",
            "brownconrady",
        ),
        *("radtan", "radialtangential", "pinholeradtan"),
    )
)
_REALSENSE = frozenset(("inversebrownconrady", "modifiedbrownconrady"))
_LENGTHS = (0, 4, 5, 8, 12, 14)  # what OpenCV knows
_OURS = 8  # the most that `CameraModel` takes: without thin prism and tilt
Kind = Literal["opencv", "ros", "toml"]


def read_camera(
    path: Path, size_px: tuple[int, int] | None = None, name: str | None = None
) -> CameraModel:
    """Intrinsics of one camera; size_px (width, height) is used where the file tells none.

    name: of the camera, where the file holds several. Distortion with 12 or 14 numbers is expressed
    with 8. Raises InputError naming the file and what is wrong: not readable, a key that is not
    understood, several cameras, another lens model, no size.
    """
    try:
        document = read_document(path)
        table = _chosen(cameras_in(document, strict=path.suffix.lower() != ".toml"), name)
        return _camera(table, size_px)
    except InputError as error:
        raise InputError(f"{path}: {brief(str(error))}") from error


def size_in(path: Path, name: str | None = None) -> tuple[int, int] | None:
    """The picture's size that a camera file tells, None where it tells none; raises as `read_camera`."""
    try:
        table = _chosen(
            cameras_in(read_document(path), strict=path.suffix.lower() != ".toml"), name
        )
        size, matrix = _size(table), _matrix(table.matrix, table.matrix_key)
        near = (
            max(1, round(2 * matrix[0, 2])),
            max(1, round(2 * matrix[1, 2])),
        )  # about its middle
        _camera(table, near)
    except InputError as error:
        raise InputError(f"{path}: {brief(str(error))}") from error
    return size


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


def _chosen(cameras: Sequence[CameraTable], name: str | None) -> CameraTable:
    """The camera that is meant."""
    if not cameras:
        raise InputError(
            "holds no camera matrix (camera_matrix, K, fx fy cx cy, or [camera] matrix)"
        )
    names = ", ".join(camera.name or "(top)" for camera in cameras)
    if name is not None:
        meant = [camera for camera in cameras if name in (camera.name, camera.name.split(".")[-1])]
        if len(meant) != 1:
            raise InputError(f"holds no camera named '{name}'; its cameras: {names}")
        return meant[0]
    if len(cameras) > 1:
        raise InputError(
            f"holds several cameras: {names}; choose with --camera-name, or name in [camera], or "
            "--as camera_name=NAME of vgrd import"
        )
    return cameras[0]


def _camera(table: CameraTable, size_px: tuple[int, int] | None) -> CameraModel:
    model = _model(table)
    distortion = _distortion(table)
    size = _size(table) or size_px
    if size is None:
        raise InputError(
            "does not tell the picture's size: add image_width and image_height, or give it beside "
            "the file (--size-px, size_px in [camera])"
        )
    matrix = _matrix(table.matrix, table.matrix_key)
    _check_size_order(matrix, size)
    _check(
        implausible_matrix(matrix, size),
        "camera matrix" if table.matrix_key == "fx" else table.matrix_key,
    )
    if model in _REALSENSE and distortion.any():
        camera = expressed(matrix, size, distortion[:5], RAYS[model], f"model {model}")
    elif distortion.size > _OURS and distortion[_OURS:].any():
        camera = expressed(matrix, size, distortion, opencv_rays, "thin prism or tilt distortion")
    else:
        camera = CameraModel(matrix, distortion[:_OURS], size)
    _check(implausible_distortion(camera), table.distortion_key or "distortion")
    return _of_the_pictures(camera, table.more)


def _distortion(table: CameraTable) -> Array:
    value = table.distortion
    if value is None:
        return np.zeros(0)
    if isinstance(value, Mapping) and "data" not in value:
        named = {plain(key): number for key, number in value.items()}
        unknown = next((key for key in value if plain(key) not in NUMBERED), None)
        if unknown is not None:
            raise InputError(
                f"{table.distortion_key}.{unknown}: is not understood; known: "
                + ", ".join(NUMBERED)
            )
        last = max((NUMBERED.index(key) for key in named), default=-1) + 1
        length = next(count for count in _LENGTHS if count >= last)
        value = [named.get(key, 0.0) for key in NUMBERED[:length]]
    numbers = _values(value, table.distortion_key or "distortion").ravel()
    if numbers.size not in _LENGTHS:
        raise InputError(
            f"distortion has {numbers.size} numbers, OpenCV knows " + ", ".join(map(str, _LENGTHS))
        )
    return numbers


def _model(table: CameraTable) -> str:
    """The lens model as one word, "" where none is told; InputError for one that is not known here."""
    special = ""
    for key, value in table.models.items():
        word = plain(value)
        if plain(key).endswith(("fisheye", "fisheyemodel")):
            if word in ("1", "10", "true"):
                raise _other_lens("fisheye")
            continue
        word = word.removeprefix("rs2").removeprefix("distortionmodel").removeprefix("distortion")
        if word in _REALSENSE:
            special = word
        elif word not in _PINHOLE:
            raise _other_lens(str(value), key)
    return special


def _other_lens(name: str, key: str = "") -> InputError:
    where = f" ({key})" if key else ""
    return InputError(
        f"distortion model {name!r} is not known here{where}: a pinhole camera with OpenCV's "
        "plumb_bob or rational_polynomial is needed; calibrate anew with vgrd intrinsics"
    )


def _matrix(value: object, key: str) -> Array:
    if isinstance(value, Mapping) and "data" not in value:
        named = {plain(k): v for k, v in value.items()}
        named |= {"cx": named.get("cx", named.get("ppx")), "cy": named.get("cy", named.get("ppy"))}
        lacking = [k for k in ("fx", "fy", "cx", "cy") if named.get(k) is None]
        if lacking:
            raise InputError(f"{key}: lacks {', '.join(lacking)}")
        value = [named[k] for k in ("fx", "fy", "cx", "cy")]
    numbers = _values(value, "camera matrix")
    is_flat, numbers = numbers.ndim == 1, numbers.ravel()
    if numbers.size == 4:
        fx, fy, cx, cy = numbers
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if numbers.size != 9:
        raise InputError(
            f"the camera matrix has {numbers.size} numbers, 9 or fx fy cx cy are needed"
        )
    matrix = numbers.reshape(3, 3)
    if matrix[2, :2].any() and not matrix[:2, 2].any():
        if is_flat and plain(key) == "intrinsicmatrix":  # Open3D writes column by column
            return np.ascontiguousarray(matrix.T)
        raise InputError(f"{key}: is written column by column; write it row by row")
    return matrix


def _size(table: CameraTable) -> tuple[int, int] | None:
    value = table.size
    if isinstance(value, Mapping):
        named = {plain(key): number for key, number in value.items()}
        if {"width", "height"} <= named.keys():
            value = [named["width"], named["height"]]
    return None if value is None else _whole(value)


def _whole(value: object) -> tuple[int, int]:
    numbers = _values(value, "picture size").ravel()
    if numbers.size != 2 or (numbers < 1).any() or (numbers % 1).any():
        raise InputError(f"picture size {value!r}: two whole numbers are needed, width and height")
    return int(numbers[0]), int(numbers[1])


def _check_size_order(matrix: Array, size: tuple[int, int]) -> None:
    """Refuse height and width in the wrong order where the principal point tells it."""
    centre = matrix[:2, 2]
    if (centre >= size).any() and (centre < size[::-1]).all():
        raise InputError(
            f"picture size {size[0]} x {size[1]}: the principal point ({centre[0]:.0f}, "
            f"{centre[1]:.0f}) lies outside: are width and height swapped?"
        )


def _check(fault: str | None, key: str) -> None:
    if fault is not None:
        raise InputError(f"{key}: {fault}")


def _of_the_pictures(camera: CameraModel, more: Mapping[str, object]) -> CameraModel:
    """The camera as its pictures are: of a region, binned; camera_info is of the whole sensor."""
    region = more.get("roi")
    x, y, width, height = (
        _count(region.get(key, 0), f"roi.{key}") if isinstance(region, Mapping) else 0
        for key in ("x_offset", "y_offset", "width", "height")
    )
    bins = [max(1, _count(more.get(key, 0), key)) for key in ("binningx", "binningy")]
    if bins == [1, 1] and not (x or y):
        return camera
    size = (width or camera.size_px[0] - x, height or camera.size_px[1] - y)
    K = camera.matrix.copy()
    K[:2, 2] = (K[:2, 2] - [x, y] + 0.5) / bins - 0.5  # pixels count from the first one's centre
    K[[0, 1], [0, 1]] /= bins
    return CameraModel(K, camera.distortion, (size[0] // bins[0], size[1] // bins[1]))


def _count(value: object, key: str) -> int:
    if not isinstance(value, int | float) or value % 1 or not 0 <= value < 1e6:
        raise InputError(f"{key} {value!r}: a whole number is needed")
    return int(value)


def _values(value: object, key: str) -> Array:
    data = value.get("data") if isinstance(value, Mapping) else value
    try:
        numbers = np.array(data, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{key} {data!r}: numbers are needed") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{key} {data!r}: finite numbers are needed")
    return numbers


def _numbers(values: object) -> str:
    return "[" + ", ".join(repr(float(x)) for x in np.ravel(np.asarray(values))) + "]"
