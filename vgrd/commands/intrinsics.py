"""Commands for camera files: intrinsics from pictures of a board, and conversion."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.boards import CameraNameOption, board_in_file, charuco_board, tag_grid
from vgrd.commands.printing import (
    JsonOption,
    Result,
    console,
    flat,
    print_result,
    progress,
    show_fields,
    table,
)
from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.vision.intrinsics.pictures import Board, BoardPictures


def register(app: typer.Typer) -> None:
    """Add intrinsics and camera."""
    app.command()(intrinsics)
    app.command()(camera)


def intrinsics(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with pictures.")],
    board: Annotated[
        str, typer.Option(help="charuco, tags, or a board file (.toml).")
    ] = "charuco",
    squares: Annotated[str, typer.Option(help="charuco: columns x rows of squares.")] = "5x7",
    square_mm: Annotated[
        float, typer.Option("--square-mm", help="charuco: measured.")
    ] = 30.0,  # as `target charuco`
    marker_mm: Annotated[
        float, typer.Option("--marker-mm", help="charuco: measured.")
    ] = 22.0,  # as `target charuco`
    tags: Annotated[str, typer.Option(help="tags: columns x rows of tags.")] = "4x3",
    size_mm: Annotated[
        float, typer.Option("--size-mm", help="tags: measured.")
    ] = 30.0,  # a guess: 4 x 3 of them fit on A4
    gap_mm: Annotated[
        float, typer.Option("--gap-mm", help="tags: measured.")
    ] = 7.5,  # a quarter of the size, as `target grid`
    first_id: Annotated[int, typer.Option(help="tags: id of the first one.")] = 0,
    dictionary: Annotated[
        str | None, typer.Option(help="Of the markers; charuco 5x5_100, tags 36h11.")
    ] = None,
    distortion: Annotated[
        int, typer.Option(help="Numbers of distortion: 0, 4, 5 or 8.")
    ] = 4,  # as `calibrate_intrinsics`
    print_mm: Annotated[
        float | None,
        typer.Option("--print-mm", help="1 sigma of a printed point; estimated if left out."),
    ] = None,
    distance_mm: Annotated[
        float | None,
        typer.Option(
            "--distance-mm", help="Work distance of the report; the board's if left out."
        ),
    ] = None,
    tag_mm: Annotated[
        float, typer.Option("--tag-mm", help="Tag size of the report.")
    ] = 25.0,  # as in the fake cell
    out: Annotated[Path, typer.Option(help="Folder for the camera files.")] = Path("intrinsics"),
    json_to: JsonOption = None,
) -> None:
    """Calibrate a camera from pictures of a board; writes OpenCV, ROS and cell file intrinsics."""
    from vgrd.vision.intrinsics.effect import effect_on_coordinates
    from vgrd.vision.intrinsics.estimate import calibrate_intrinsics
    from vgrd.vision.intrinsics.pictures import read_board_pictures
    from vgrd.vision.intrinsics.report import report_json, write_report

    chosen: Board
    if board == "charuco":
        chosen = charuco_board(squares, square_mm, marker_mm, dictionary or "5x5_100")
    elif board == "tags":
        chosen = tag_grid(dictionary or "36h11", tags, size_mm, gap_mm, first_id)
    else:
        chosen = board_in_file(Path(board))
    if print_mm is not None and not print_mm > 0:
        raise InputError(f"--print-mm {print_mm:g}: give a positive number, or leave it out")
    with progress("finding the board") as report:
        pictures = read_board_pictures(folder, chosen, report)
    _check_views(pictures)
    result = calibrate_intrinsics(
        pictures.points_in_board,
        pictures.views,
        pictures.size_px,
        distortion=distortion,
        print_mm=print_mm,
    )
    distance = distance_mm or result.distance_mm
    effect = effect_on_coordinates(result.camera, result.covariance, distance, tag_mm)
    told = report_json(result, pictures.unusable)
    told |= {"effect": asdict(effect), "files": write_report(_output_folder(out), result)}
    print_result(told, json_to, _show)


def camera(
    source: Annotated[
        Path,
        typer.Argument(
            help="File of OpenCV, ROS, Kalibr, RealSense, Open3D, Zivid, NPZ, or a cell file."
        ),
    ],
    camera_name: CameraNameOption = None,
    size_px: Annotated[
        str | None,
        typer.Option(
            "--size-px", metavar="WIDTHxHEIGHT", help="Of the pictures, where the file tells none."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write .toml, or OpenCV's .yaml, .xml, .json.")
    ] = None,
    ros: Annotated[bool, typer.Option("--ros", help="Write ROS camera_info instead.")] = False,
    json_to: JsonOption = None,
) -> None:
    """Show the intrinsics in a camera file, and convert them."""
    from vgrd.vision.intrinsics.camera_files import Kind, camera_json, read_camera, write_camera

    found = read_camera(source, _size(size_px), camera_name)
    if out is not None:
        kind: Kind = "ros" if ros else "toml" if out.suffix.lower() == ".toml" else "opencv"
        write_camera(out, found, kind, out.stem)
    print_result(camera_json(found), json_to, show_fields(str(source)))


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        width, height = (int(number) for number in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size-px {text}: write width x height, such as 1280x960") from None
    return width, height


def _check_views(pictures: "BoardPictures") -> None:
    from vgrd.vision.intrinsics.estimate import MIN_VIEWS

    if len(pictures.views) < MIN_VIEWS:
        why = "".join(f"\n  {name}: {reason}" for name, reason in pictures.unusable.items())
        raise InputError(
            f"the board is in {len(pictures.views)} pictures, at least {MIN_VIEWS} are needed "
            f"(20 are good); do --board and its sizes fit?{why}"
        )


def _output_folder(out: Path) -> Path:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be made: {error.strerror}") from error
    return out


def _show(result: Result) -> None:
    keys = ("name", "used", "points", "dropped", "rms_px", "held_out_px", "tilt_deg", "reason")
    rows = [[picture.get(key) for key in keys] for picture in result["pictures"]]
    console.print(table("pictures", keys, rows))
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = [*result["matrix"], *result["distortion"]]
    rows = [
        [name, f"{value:.6g}", f"{result['sigma'][name]:.2g}"]
        for name, value in zip(names, values, strict=False)
    ]
    console.print(table("camera", ("what", "value", "1 sigma"), rows))
    keep = ("rms_px", "held_out_px", "noise", "findings", "files")
    console.print(
        table("quality", ("what", "value"), list(flat({key: result[key] for key in keep})))
    )
    effect = result["effect"]
    console.print(
        f"At {effect['distance_mm']:.0f} mm the intrinsics make a coordinate uncertain by "
        f"{effect['xy_mm']:.4f} mm across and {effect['z_mm']:.4f} mm along tag A's normal (1 sigma).",
        highlight=False,
    )
