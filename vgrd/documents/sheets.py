"""Tables of samples as programs write them: CSV, JSON, YAML, NPZ, all as columns by name.

A cell is a number, a word, or nested lists of numbers. Nested tables become names with dots:
`pose.position.x`.
"""

import csv
import io
import json
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vgrd.documents.text import binary_kind, brief, decoded, read_bytes
from vgrd.errors import InputError

Cell = Any  # float, str, or nested lists of floats: what the user's program wrote
_MOST_ROWS = 100_000  # a guess: a day of a tracker at 1 Hz; more is no list of samples
_DELIMITERS = (",", ";", "\t")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
_MOST_COMPONENTS = 4  # of a quaternion: columns of lists count no further
_COUNTED = re.compile(r"(.*?[^0-9])([0-9]{1,6})")
_COMMENTS = ("#", "%", "//")
_DEEPEST = 8  # of tables in tables; a guess: ROS messages have four
_SLOW_YAML = 3_000_000  # characters: its reader takes half a minute for them


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Columns of one length by name, and where each row stands, for messages ("line 3", "entry 2")."""

    columns: Mapping[str, Sequence[Cell]]
    places: Sequence[str]

    def __len__(self) -> int:
        return len(self.places)


def read_sheet(path: Path) -> Sheet:
    """The table of a file; InputError names the file, the place and what is wrong."""
    try:
        return _checked(_sheet(read_bytes(path), path.suffix.lower()))
    except InputError as error:
        raise InputError(f"{path}: {brief(str(error))}") from error
    except RecursionError as error:
        raise InputError(f"{path}: not valid: nested too deeply") from error


def _checked(sheet: Sheet) -> Sheet:
    if not len(sheet):
        raise InputError("holds no rows: a table of samples is needed")
    if len(sheet) > _MOST_ROWS:
        raise InputError(f"holds {len(sheet)} rows, at most {_MOST_ROWS} are read")
    return sheet


def finite(cell: Cell, where: str) -> list[float]:
    """The numbers of a cell, flat; InputError naming the place for a word, nothing or NaN."""
    if cell is None or cell == "":
        raise InputError(f"{where}: the cell is empty: leave the sample out")
    try:
        numbers = np.asarray(cell, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {str(cell)[:60]!r} is no number") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: {str(cell)[:60]} is not finite: leave the sample out")
    return [float(number) for number in numbers]


def _sheet(data: bytes, suffix: str) -> Sheet:
    if not data.strip():
        raise InputError("is empty: a table of samples is needed")
    kind = binary_kind(data)
    if data.startswith(b"PK\x03\x04"):
        return _npz(data)
    if data.startswith(b"\x93NUMPY"):
        return _arrays({"array": _npy(data)})
    if kind is not None:
        raise InputError(f"is {kind}: a table as CSV, JSON, YAML or NPZ is needed")
    text = decoded(data)
    if text.lstrip()[:1] in ("{", "[") and suffix not in (".yaml", ".yml"):
        try:
            return from_nested(json.loads(text))
        except ValueError as error:
            raise InputError(f"not valid JSON: {error}") from error
    if text.startswith("%YAML:") or "<opencv_storage" in text[:1000]:
        raise InputError("is a file of OpenCV's FileStorage: read it with its reader")
    if suffix in (".yaml", ".yml"):
        return from_nested(_yaml(text))
    if suffix in (".xml", ".html") or text.lstrip().startswith("<"):
        raise InputError("is XML: a table as CSV, JSON, YAML or NPZ is needed")
    return _csv(text)


def _yaml(text: str) -> object:
    if len(text) > _SLOW_YAML:
        raise InputError(f"has {len(text)} characters: write so long a table as JSON or CSV")
    try:
        documents = [data for data in yaml.safe_load_all(text) if data is not None]
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"not valid YAML: {' '.join(str(error).splitlines()[:3])}") from error
    return documents[0] if len(documents) == 1 else documents


def _npy(data: bytes) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"is no NumPy array of plain numbers ({error})") from error


def _npz(data: bytes) -> Sheet:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return _arrays({name: archive[name] for name in archive.files})
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"is a ZIP archive but no NPZ of plain numbers ({error})") from error


def _arrays(arrays: Mapping[str, np.ndarray[Any, Any]]) -> Sheet:
    """Arrays with one entry per sample; others, such as a camera matrix, are left out."""
    lengths = [len(array) for array in arrays.values() if array.ndim > 0]
    if not lengths:
        raise InputError("holds no arrays with an entry for each sample")
    count = max(lengths, key=lambda length: (lengths.count(length), length))
    columns = {
        name: array.tolist()
        for name, array in arrays.items()
        if array.ndim > 0 and len(array) == count
    }
    return Sheet(columns, [f"entry {i}" for i in range(count)])


def from_nested(data: object) -> Sheet:
    """Columns of lists of tables, of tables of lists, and of lists of lists."""
    rows = list(_rows(data, _DEEPEST))
    if not rows:
        raise InputError("holds no list of samples")
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    return Sheet(columns, [f"entry {i}" for i in range(len(rows))])


def _rows(data: object, left: int) -> Iterator[dict[str, Cell]]:
    if left == 0:
        raise InputError("not valid: nested too deeply")
    if isinstance(data, Mapping):
        lists = {str(k): v for k, v in data.items() if isinstance(v, list) and len(v) > 1}
        tables = {k: v for k, v in lists.items() if all(isinstance(e, Mapping) for e in v)}
        if tables:
            yield from _rows(max(tables.values(), key=len), left - 1)
        elif numbered := _numbered(data):
            yield from numbered
        elif lists and len({len(v) for v in lists.values()}) == 1:
            for values in zip(*lists.values(), strict=True):
                yield dict(zip(lists, values, strict=True))
        elif data and all(isinstance(value, Mapping) for value in data.values()):
            if len(data) == 1:
                yield from _rows(next(iter(data.values())), left - 1)
                return
            for name, value in data.items():
                yield {"name": str(name), **dict(_flat(value, "", left - 1))}
        elif len(data) == 1:
            yield from _rows(next(iter(data.values())), left - 1)
        elif any(isinstance(value, int | float | list | Mapping) for value in data.values()):
            yield dict(
                _flat(data, "", left - 1)
            )  # one sample, such as a pose in a file of its own
        return
    if not isinstance(data, list):
        return
    for row in data:
        if isinstance(row, Mapping):
            yield dict(_flat(row, "", left - 1))
        elif isinstance(row, list):
            yield {str(i): cell for i, cell in enumerate(row)}


def _numbered(data: Mapping[Any, Any]) -> list[dict[str, Cell]]:
    """Rows of keys that count: robot_0, camera_0, robot_1, ...; none where they do not."""
    rows: dict[int, dict[str, Cell]] = {}
    for key, value in data.items():
        found = _COUNTED.fullmatch(str(key))
        if found and isinstance(value, list):
            rows.setdefault(int(found[2]), {})[found[1].rstrip("_-. ")] = value
    names = {frozenset(row) for row in rows.values()}
    if len(rows) < 2 or len(names) > 1:
        return []
    cells = [cell for row in rows.values() for cell in row.values()]
    are_matrices = all(isinstance(inner, list) for cell in cells for inner in cell)
    # q1 to q4 are columns of a table that is written column by column.
    return [rows[i] for i in sorted(rows)] if are_matrices or len(rows) > _MOST_COMPONENTS else []


def _flat(table: Mapping[Any, Any], prefix: str, left: int) -> Iterator[tuple[str, Cell]]:
    if left == 0:
        raise InputError("not valid: nested too deeply")
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.", left - 1)
        else:
            yield f"{prefix}{key}", value


def _csv(text: str) -> Sheet:
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    body = [(number, line) for number, line in lines if not _is_comment(line)]
    if not body:
        raise InputError("holds no rows: a table of samples is needed")
    delimiter = max(_DELIMITERS, key=body[0][1].count)
    if delimiter not in body[0][1]:
        delimiter = " "
    rows = [(number, _cells(line, delimiter)) for number, line in body]
    names, rows = _named(rows, [line for number, line in lines if number < body[0][0]], delimiter)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"column '{twice}' is there twice: give each column its own name")
    for number, cells in rows:
        if len(cells) != len(names):
            raise InputError(f"line {number}: has {len(cells)} cells, the header {len(names)}")
    columns = {
        name: [_value(cells[i], delimiter) for _, cells in rows] for i, name in enumerate(names)
    }
    return Sheet(columns, [f"line {number}" for number, _ in rows])


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _named(
    rows: list[tuple[int, list[str]]], heads: Sequence[str], delimiter: str
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Names of the columns and the rows below: the first row, or a comment above it that has its cells."""
    first = rows[0][1]
    if not any(isinstance(_value(cell, delimiter), float) for cell in first):
        return first, rows[1:]
    for head in reversed(heads):
        names = _cells(head.strip().lstrip("#%/ "), delimiter)
        if len(names) == len(first):
            return names, rows
    return [str(i) for i in range(len(first))], rows


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except (csv.Error, StopIteration) as error:
        raise InputError(f"not valid CSV: {error}") from error
    return [cell.strip() for cell in cells]


def _value(cell: str, delimiter: str) -> float | str | list[float]:
    if cell.startswith("[") and cell.endswith("]"):  # as pandas and NumPy write lists into a cell
        try:
            return [float(word) for word in re.split(r"[\s,;]+", cell.strip("[] ")) if word]
        except ValueError:
            return cell
    plain = cell.replace(",", ".") if delimiter != "," and _DECIMAL_COMMA.fullmatch(cell) else cell
    try:
        return float(plain)
    except ValueError:
        return cell
