"""The board that a command's options or a board file mean."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from vgrd.errors import ConfigError, InputError

if TYPE_CHECKING:
    from vgrd.vision.intrinsics.pictures import Board
    from vgrd.vision.print.boards import Charuco
    from vgrd.vision.print.targets import TagGrid


def charuco_board(squares: str, square_mm: float, marker_mm: float, dictionary: str) -> "Charuco":
    """The ChArUco board of --squares and so on; InputError when it cannot exist."""
    from vgrd.vision.print.boards import BOARD_DICTIONARIES, Charuco
    from vgrd.vision.print.codes import family_named

    columns, rows = _columns_and_rows("--squares", squares)
    name = family_named(dictionary)
    if name not in BOARD_DICTIONARIES:
        raise InputError(
            f"--dictionary {dictionary}: ChArUco boards have ArUco markers; known: "
            + ", ".join(BOARD_DICTIONARIES)
        )
    return Charuco(columns, rows, square_mm, marker_mm, name)


def tag_grid(
    dictionary: str, tags: str, size_mm: float, gap_mm: float, first_id: int
) -> "TagGrid":
    """The board of --tags and so on; InputError when it cannot exist."""
    from vgrd.vision.print.codes import family_named
    from vgrd.vision.print.targets import TagGrid

    columns, rows = _columns_and_rows("--tags", tags)
    return TagGrid(family_named(dictionary), columns, rows, size_mm, gap_mm, first_id)


def board_in_file(path: Path) -> "Board":
    """The [target] of a board file or DATASET.toml, or its keys without a table.

    Raises InputError for another kind of file, ConfigError with all faults of this one.
    """
    from vgrd.solving.datasets.document import (
        TARGET_TABLES,
        Count,
        LengthMm,
        Table,
        TargetTable,
        hint,
        parse,
    )
    from vgrd.solving.datasets.loading import read_toml
    from vgrd.vision.print.boards import SingleTag
    from vgrd.vision.print.targets import TagGrid

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
            size = str(self.columns) + "x" + str(self.rows)
            return tag_grid(self.dictionary, size, self.size_mm, self.gap_mm, self.first_id)

    if path.suffix.lower() != ".toml":
        raise InputError(f"--board {path}: charuco, tags, or a board file that ends with .toml")
    data = read_toml(path)
    given = data.get("target", data)
    kind = given.get("type") if isinstance(given, dict) else None
    known = (*TARGET_TABLES, "tags")
    if kind not in known:
        raise ConfigError(str(path), [f"target.type: {kind!r} is unknown{hint(str(kind), known)}"])
    model: type[TargetTable | TagsTable] = TagsTable if kind == "tags" else TARGET_TABLES[kind]
    faults: list[str] = []
    parsed = parse(model, given, "target", faults)
    if parsed is None:
        raise ConfigError(str(path), faults)
    found = parsed.spec()
    if isinstance(found, SingleTag):
        raise ConfigError(str(path), ["target.type: one tag is not enough; print a board"])
    return found


def _columns_and_rows(option: str, text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(number) for number in text.lower().split("x"))
    except ValueError:
        raise InputError(f"{option} {text}: write columns x rows, such as 5x7") from None
    if columns < 1 or rows < 1 or columns * rows < 2:
        raise InputError(f"{option} {text}: a board has at least two fields")
    return columns, rows
