"""Commands that print targets: tags, boards of tags, ChArUco boards."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.boards import charuco_board, tag_grid
from vgrd.commands.printing import JsonOption, print_result, show_fields

if TYPE_CHECKING:
    from vgrd.vision.print.targets import Printable

SizeOption = Annotated[float, typer.Option("--size-mm", help="Edge of the black square.")]
OutOption = Annotated[Path, typer.Option("--out", help="File: .pdf, .svg or .png.")]
PageOption = Annotated[
    str, typer.Option("--page", help="a5, a4, a3, letter, tabloid, WIDTHxHEIGHT in mm, or bare.")
]
DpiOption = Annotated[  # guesses: what is beyond them is a slip
    int, typer.Option("--dpi", min=10, max=4800, help="Of a PNG.")
]
DictionaryArgument = Annotated[
    str, typer.Argument(help="AprilTag family such as 36h11, or ArUco dictionary such as 4x4_50.")
]


def register(app: typer.Typer) -> None:
    """Add target tag, target grid and target charuco."""
    target = typer.Typer(no_args_is_help=True, help="Draw targets to print, at exact size.")
    for command in (tag, grid, charuco):
        target.command()(command)
    app.add_typer(target, name="target")


def tag(
    dictionary: DictionaryArgument,
    tag_id: Annotated[int, typer.Argument(metavar="ID")],
    size_mm: SizeOption,
    out: OutOption,
    page: PageOption = "a4",
    dpi: DpiOption = 600,  # as office printers print
    json_to: JsonOption = None,
) -> None:
    """Draw one tag."""
    from vgrd.vision.print.targets import checked_tag

    _draw(checked_tag(dictionary, tag_id, size_mm), page, dpi, out, json_to)


def grid(
    dictionary: DictionaryArgument,
    size_mm: SizeOption,
    out: OutOption,
    tags: Annotated[str, typer.Option(help="Columns x rows of tags.")] = "4x3",
    gap_mm: Annotated[
        float | None,
        typer.Option("--gap-mm", help="Between the squares; a quarter of their size."),
    ] = None,
    first_id: Annotated[int, typer.Option(help="Id of the first tag.")] = 0,
    page: PageOption = "a4",
    dpi: DpiOption = 600,  # as office printers print
    json_to: JsonOption = None,
) -> None:
    """Draw a board of several tags."""
    gap = size_mm / 4 if gap_mm is None else gap_mm
    _draw(tag_grid(dictionary, tags, size_mm, gap, first_id), page, dpi, out, json_to)


def charuco(
    out: OutOption,
    squares: Annotated[str, typer.Option(help="Columns x rows of squares.")] = "5x7",
    square_mm: Annotated[
        float, typer.Option("--square-mm", help="Edge of a square.")
    ] = 30.0,  # 5 x 7 of them fit on A4
    marker_mm: Annotated[
        float, typer.Option("--marker-mm", help="Edge of a marker.")
    ] = 22.0,  # its white rim, 4 mm, is wider than its cells
    dictionary: Annotated[str, typer.Option(help="ArUco dictionary.")] = "5x5_100",
    page: PageOption = "a4",
    dpi: DpiOption = 600,  # as office printers print
    json_to: JsonOption = None,
) -> None:
    """Draw a ChArUco board."""
    _draw(charuco_board(squares, square_mm, marker_mm, dictionary), page, dpi, out, json_to)


def _draw(target: "Printable", page: str, dpi: int, out: Path, json_to: str | None) -> None:
    from vgrd.vision.print.sheet import write_sheet
    from vgrd.vision.print.targets import config_lines, target_sheet

    sheet = target_sheet(target, page)
    write_sheet(sheet, out, dpi)
    result = {
        "file": str(out),
        "page_mm": [sheet.width_mm, sheet.height_mm],
        "config": list(config_lines(target)),
        "next": "print at 100 %, measure the bar and the target, put the measured sizes into the config",
    }
    print_result(result, json_to, show_fields("target"))
