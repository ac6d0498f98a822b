"""The board that a command's options mean, and the option that chooses a camera of a file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.vision.intrinsics.pictures import Board
    from vgrd.vision.print.boards import Charuco
    from vgrd.vision.print.targets import TagGrid

CameraNameOption = Annotated[
    str | None,
    typer.Option("--camera-name", help="Which camera, where the camera file holds several."),
]


def charuco_board(squares: str, square_mm: float, marker_mm: float, dictionary: str) -> "Charuco":
    """The ChArUco board of --squares and so on; InputError when it cannot exist."""
    from vgrd.vision.print.boards import BOARD_DICTIONARIES, Charuco
    from vgrd.vision.print.codes import family_named
    from vgrd.vision.print.targets import check_size

    check_size("a square", square_mm)
    check_size("a marker", marker_mm)
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
    from vgrd.vision.print.targets import TagGrid, check_size

    check_size("a tag", size_mm)
    columns, rows = _columns_and_rows("--tags", tags)
    return TagGrid(family_named(dictionary), columns, rows, size_mm, gap_mm, first_id)


def board_in_file(path: Path) -> "Board":
    """The board of a board file or DATASET.toml.

    Raises InputError for another kind of file, ConfigError with all faults of this one.
    """
    if path.suffix.lower() != ".toml":
        raise InputError(f"--board {path}: charuco, tags, or a board file that ends with .toml")
    from vgrd.solving.datasets.boards import load_board

    return load_board(path)


def _columns_and_rows(option: str, text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(number) for number in text.lower().split("x"))
    except ValueError:
        raise InputError(f"{option} {text}: write columns x rows, such as 5x7") from None
    if columns < 1 or rows < 1 or columns * rows < 2:
        raise InputError(f"{option} {text}: a board has at least two fields")
    return columns, rows
