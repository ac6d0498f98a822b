"""Boards and tags in a file: the [target] of a DATASET.toml, and board files."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from vgrd.documents.tables import LengthMm, Table, one_of, parse
from vgrd.documents.toml import hint, read_toml
from vgrd.errors import ConfigError, InputError
from vgrd.vision.print.boards import (
    BOARD_DICTIONARIES,
    TAG_DICTIONARIES,
    Charuco,
    Chessboard,
    CircleGrid,
    SingleTag,
    TargetSpec,
)
from vgrd.vision.print.codes import family_named, plain_family
from vgrd.vision.print.targets import AprilGrid, TagGrid

if TYPE_CHECKING:
    from vgrd.vision.intrinsics.pictures import Board

Count = Annotated[int, Field(ge=2, le=1000)]  # one row is no raster; more is a slip


class CharucoTable(Table):
    """columns x rows squares."""

    type: Literal["charuco"]
    columns: Count
    rows: Count
    square_mm: LengthMm
    marker_mm: LengthMm
    dictionary: Annotated[str, AfterValidator(plain_family), one_of(BOARD_DICTIONARIES)]
    first_id: Annotated[int, Field(ge=0)] = 0

    def spec(self) -> TargetSpec:
        """The target as the detector knows it; InputError when it cannot exist."""
        sizes = (self.columns, self.rows, self.square_mm, self.marker_mm)
        return Charuco(*sizes, self.dictionary, self.first_id)


class ChessboardTable(Table):
    """columns x rows inner corners."""

    type: Literal["chessboard"]
    columns: Annotated[int, Field(ge=3, le=1000)]
    rows: Annotated[int, Field(ge=3, le=1000)]
    square_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        return Chessboard(self.columns, self.rows, self.square_mm)


class CirclesTable(Table):
    """columns x rows circles."""

    type: Literal["circles", "asymmetric-circles"]
    columns: Count
    rows: Count
    spacing_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        asymmetric = self.type == "asymmetric-circles"
        return CircleGrid(self.columns, self.rows, self.spacing_mm, asymmetric)


class TagTable(Table):
    """One tag."""

    type: Literal["tag"]
    dictionary: Annotated[str, AfterValidator(plain_family), one_of(TAG_DICTIONARIES)]
    id: Annotated[int, Field(ge=0)]
    size_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        return SingleTag(self.dictionary, self.id, self.size_mm)


class TagsTable(Table):
    """columns x rows tags."""

    type: Literal["tags"]
    dictionary: str
    columns: Count
    rows: Count
    size_mm: LengthMm
    gap_mm: LengthMm
    first_id: Annotated[int, Field(ge=0)] = 0

    def spec(self) -> TagGrid:
        """The board; InputError when it cannot exist."""
        family = family_named(self.dictionary)
        return TagGrid(family, self.columns, self.rows, self.size_mm, self.gap_mm, self.first_id)


class AprilGridTable(Table):
    """columns x rows tags of Kalibr's AprilGrid; size_mm: tagSize, gap_mm: tagSpacing times tagSize."""

    type: Literal["aprilgrid"]
    dictionary: Literal["36h11"] = "36h11"
    border_bits: Annotated[int, Field(ge=1, le=2)] = 2
    columns: Count
    rows: Count
    size_mm: LengthMm
    gap_mm: LengthMm | None = None
    spacing: Annotated[float, Field(gt=0, le=1)] | None = None  # wider gaps are mm, not a share
    first_id: Annotated[int, Field(ge=0)] = 0

    def spec(self) -> AprilGrid:
        """The board; InputError when it cannot exist."""
        if (self.gap_mm is None) == (self.spacing is None):
            raise InputError("give gap_mm, or spacing (Kalibr's tagSpacing), one of both")
        gap = self.size_mm * self.spacing if self.spacing is not None else self.gap_mm
        family = "36h11_border2" if self.border_bits == 2 else "36h11"
        return AprilGrid(
            family, self.columns, self.rows, self.size_mm, float(gap or 0), self.first_id
        )


TargetTable = CharucoTable | ChessboardTable | CirclesTable | TagTable | TagsTable | AprilGridTable
TARGET_TABLES: Mapping[str, type[TargetTable]] = {
    "charuco": CharucoTable,
    "chessboard": ChessboardTable,
    "circles": CirclesTable,
    "asymmetric-circles": CirclesTable,
    "tag": TagTable,
    "tags": TagsTable,
    "aprilgrid": AprilGridTable,
}


def read_target(table: object, faults: list[str]) -> TargetSpec | TagGrid | None:
    """The target that a [target] table describes, or None with every fault appended."""
    target = _check_table(table, faults)
    try:
        return target.spec() if target is not None else None
    except InputError as error:
        faults.append(f"target: {error}")
        return None


def load_board(path: Path) -> "Board":
    """The [target] of a board file or DATASET.toml, or its keys without a table.

    Raises ConfigError with all faults of the file, InputError for a board that cannot exist.
    """
    data = read_toml(path, "a board file (.toml)")
    faults: list[str] = []
    table = _check_table(data.get("target", data), faults)
    if table is None:
        raise ConfigError(str(path), faults)
    board = table.spec()
    if isinstance(board, SingleTag):
        raise ConfigError(str(path), ["target.type: one tag is not enough; print a board"])
    return board


def _check_table(table: object, faults: list[str]) -> TargetTable | None:
    """The table checked as one of the type it names."""
    kind = table.get("type") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in TARGET_TABLES:
        faults.append(f"target.type: {kind!r} is unknown{hint(str(kind), tuple(TARGET_TABLES))}")
        return None
    return parse(TARGET_TABLES[kind], table, "target", faults)
