"""The camera of a dataset: its numbers in [camera], or the camera file that [camera] names."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.documents.tables import parse
from vgrd.errors import InputError
from vgrd.geometry.camera import CameraModel, implausible_distortion, implausible_matrix
from vgrd.solving.datasets.reading.document import CameraTable
from vgrd.vision.images.pictures import read_picture
from vgrd.vision.intrinsics.camera_files import read_camera


@dataclass(frozen=True, slots=True, eq=False)
class DatasetCamera:
    """The camera, whether it is to be refined, and (width, height) of its pictures, None where not told."""

    model: CameraModel
    refine: bool
    picture_px: tuple[int, int] | None


def read_dataset_camera(
    data: Mapping[str, Any],
    kinds: Collection[str],
    folder: Path,
    pictures: Sequence[Path],
    faults: list[str],
) -> DatasetCamera | None:
    """The camera; None where the samples need none, or faults are appended.

    kinds: of what the samples hold; folder: from which the name of a camera file counts; pictures: of the
    samples, whose size counts where the camera file tells none.
    """
    if "camera" not in data:
        if {"image", "points"} & set(kinds):
            faults.append(
                "camera: is missing; samples with image or points need [camera] matrix or file"
            )
        return None
    table = parse(CameraTable, data["camera"], "camera", faults)
    if table is None:
        return None
    if table.refine and not {"image", "points"} & set(kinds):
        faults.append("camera.refine: poses hold no pixels to refine from; set it to false")
    try:
        model = _model(table, folder, pictures)
    except InputError as error:
        faults.append(f"camera: {error}")
        return None
    if not {"image", "points"} & set(kinds):
        return None
    is_told = table.file is not None or table.size_px is not None
    return DatasetCamera(model, table.refine, model.size_px if is_told else None)


def _model(table: CameraTable, folder: Path, pictures: Sequence[Path]) -> CameraModel:
    if table.file is not None:
        if table.matrix is not None or table.distortion is not None:
            raise InputError(f"file '{table.file}' and matrix or distortion: keep one of them")
        size = _size(table) or _size_of(pictures)
        return read_camera(folder / table.file, size, table.name)
    if table.name is not None:
        raise InputError(f"name '{table.name}' is of a camera in a file: add file, or remove it")
    if table.matrix is None:
        raise InputError(
            "matrix is missing: add matrix = [fx, fy, cx, cy], or file = a camera file"
        )
    fx, fy, cx, cy = table.matrix
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    middle = (max(1, round(2 * cx)), max(1, round(2 * cy)))  # the principal point is near it
    fault = implausible_matrix(K, _size(table))
    if fault is not None:
        raise InputError(f"matrix: {fault}")
    camera = CameraModel(K, np.array(table.distortion or []), _size(table) or middle)
    fault = implausible_distortion(camera)
    if fault is not None:
        raise InputError(f"distortion: {fault}")
    return camera


def _size(table: CameraTable) -> tuple[int, int] | None:
    return None if table.size_px is None else (table.size_px[0], table.size_px[1])


def _size_of(pictures: Sequence[Path]) -> tuple[int, int] | None:
    """(width, height) of the first picture that can be read; the others are held against it."""
    for path in pictures:
        try:
            height, width = read_picture(path).pixels.shape
        except InputError:
            continue  # told with the sample
        return width, height
    return None
