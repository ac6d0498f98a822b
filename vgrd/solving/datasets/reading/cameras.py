"""The camera of a dataset: its numbers in [camera], or the camera file that [camera] names."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.documents.tables import parse
from vgrd.errors import InputError
from vgrd.geometry.camera import CameraModel, implausible_distortion, implausible_matrix
from vgrd.solving.datasets.reading.document import CameraTable
from vgrd.vision.intrinsics.camera_files import read_camera


def read_dataset_camera(
    data: Mapping[str, Any], kinds: Collection[str], folder: Path, faults: list[str]
) -> tuple[CameraModel, bool] | None:
    """The camera and whether it is to be refined; None where the samples need none, or faults are appended.

    kinds: of what the samples hold; folder: from which the name of a camera file counts.
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
        model = _model(table, folder)
    except InputError as error:
        faults.append(f"camera: {error}")
        return None
    return (model, table.refine) if {"image", "points"} & set(kinds) else None


def _model(table: CameraTable, folder: Path) -> CameraModel:
    if table.file is not None:
        if table.matrix is not None or table.distortion is not None:
            raise InputError(f"file '{table.file}' and matrix or distortion: keep one of them")
        return read_camera(folder / table.file, _size(table), table.name)
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
