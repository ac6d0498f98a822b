"""CSV files that pair points of the target with pixels."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vgrd.documents.text import brief, read_text, shortened
from vgrd.errors import InputError
from vgrd.vision.print.boards import BoardObservation

_HEADER = ["x_mm", "y_mm", "z_mm", "u_px", "v_px"]
_SMALLEST_TARGET_MM = 1.0  # smaller is another unit


def read_points(path: Path) -> BoardObservation:
    """Points of the target and their pixels from a CSV file; InputError names file, line, fault."""
    try:
        lines = list(csv.reader(read_text(path).splitlines()))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except csv.Error as error:
        raise InputError(f"{path}: not valid CSV: {error}") from error
    header = [word.strip() for word in lines[0]] if lines else []
    if header != _HEADER:
        raise InputError(
            f"{path}: header must be {','.join(_HEADER)}, got {shortened(str(header))}"
        )
    rows = [_numbers(line, path, number) for number, line in enumerate(lines[1:], 2) if line]
    values = np.array(rows).reshape(-1, len(_HEADER))
    points = values[:, :3]
    if len(points) and np.ptp(points, axis=0).max() < _SMALLEST_TARGET_MM:
        span = float(np.ptp(points, axis=0).max())
        raise InputError(f"{path}: the points span {span:g} mm only: are they in metres?")
    return BoardObservation(points, values[:, 3:], len(points))


def _numbers(line: Sequence[str], path: Path, number: int) -> list[float]:
    try:
        values = [float(word) for word in line]
    except ValueError as error:
        raise InputError(f"{path} line {number}: {brief(str(error))}") from error
    if len(values) != len(_HEADER) or not np.isfinite(values).all():
        raise InputError(
            f"{path} line {number}: {len(_HEADER)} finite numbers are needed, got "
            f"{shortened(str(line))}"
        )
    return values
