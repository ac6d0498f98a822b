"""[samples] of a dataset: samples in a table of columns, pictures in natural order, as [[sample]] tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vgrd.documents.natural_order import natural_order
from vgrd.documents.sheets import Sheet, finite, read_sheet
from vgrd.documents.tables import parse
from vgrd.documents.toml import hint
from vgrd.errors import InputError
from vgrd.solving.datasets.reading.document import SamplesTable

_NUMBERS = ("pose", "camera_from_target", "rvec", "tvec", "point_in_camera")
_FILES = {
    "images": "image",
    "points": "points",
}  # patterns, and the key of a sample that they fill


def with_samples_table(data: Mapping[str, Any], folder: Path, faults: list[str]) -> dict[str, Any]:
    """The dataset with every row of [samples] as a [[sample]]; faults are appended."""
    whole = dict(data)
    if "samples" not in whole:
        return whole
    table = parse(SamplesTable, whole.pop("samples"), "samples", faults)
    if table is None:
        return whole
    try:
        whole["sample"] = _with_files(table, folder, _all_rows(table, folder, whole))
    except InputError as error:
        faults.append(f"samples: {error}")
    return whole


def _all_rows(
    table: SamplesTable, folder: Path, data: Mapping[str, Any]
) -> Sequence[dict[str, Any]]:
    written = data.get("sample", [])
    if table.table is None:
        return written if isinstance(written, list) else []
    if written:
        raise InputError("table and [[sample]]: keep one of them")
    return _rows(table, folder)


def _rows(table: SamplesTable, folder: Path) -> list[dict[str, Any]]:
    """The rows of the file as [[sample]] tables."""
    sheet = read_sheet(folder / str(table.table))
    if table.pose is None:
        raise InputError(
            "pose is missing: name the columns of the flange poses, such as pose = "
            f'["x", "y", "z", "qx", "qy", "qz", "qw"]; columns: {", ".join(sheet.columns)}'
        )
    rows: list[dict[str, Any]] = [{"name": str(number)} for number in range(len(sheet))]
    for key in _NUMBERS:
        names = getattr(table, key)
        if names is None:
            continue
        columns = [_column(sheet, name) for name in ([names] if isinstance(names, str) else names)]
        for row, place, *cells in zip(rows, sheet.places, *columns, strict=True):
            row[key] = [
                number
                for cell in cells
                for number in finite(cell, f"{table.table} {place}, {key}")
            ]
    for key in ("name", "image"):
        name = getattr(table, key)
        for row, cell in zip(rows, _column(sheet, name) if name else (), strict=False):
            row[key] = f"{cell:g}" if isinstance(cell, float) else str(cell)
    return rows


def _column(sheet: Sheet, name: str) -> Sequence[Any]:
    if name not in sheet.columns:
        raise InputError(f"no column '{name}'{hint(name, tuple(sheet.columns), 'columns')}")
    return sheet.columns[name]


def _with_files(
    table: SamplesTable, folder: Path, rows: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """The samples with their pictures or points files, in natural order."""
    whole = [dict(row) if isinstance(row, dict) else row for row in rows]
    for pattern_key, key in _FILES.items():
        pattern = getattr(table, pattern_key)
        if pattern is None:
            continue
        names = _matching(folder, pattern, pattern_key)
        if len(names) != len(whole):
            raise InputError(
                f"{pattern_key} '{pattern}': {len(names)} files ({names[0]} to {names[-1]} in natural "
                f"order) for {len(whole)} samples: which belongs to which? Remove what has no partner, "
                f"or name each sample's {key}"
            )
        for row, name in zip(whole, names, strict=True):
            row.setdefault(key, name)
    return whole


def _matching(folder: Path, pattern: str, key: str) -> list[str]:
    try:
        found = [str(path.relative_to(folder)) for path in folder.glob(pattern) if path.is_file()]
    except (ValueError, NotImplementedError, OSError) as error:
        raise InputError(
            f"{key} '{pattern}': is no pattern below the dataset's folder, such as images/*.png"
        ) from error
    if not found:
        raise InputError(
            f"{key} '{pattern}': no such file (patterns count from the dataset's folder)"
        )
    return natural_order(found)
