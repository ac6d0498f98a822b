"""Commands for camera files: intrinsics from pictures of a board, and conversion."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from vgrd.commands.boards import board_in_file, charuco_board, tag_grid
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
    from vgrd.geometry.camera import CameraModel
    from vgrd.vision.intrinsics.estimate import IntrinsicsResult
    from vgrd.vision.intrinsics.pictures import Board, BoardPictures

_FEW_PICTURES, _TILTED_DEG, _LEAST_TILTED = 10, 15.0, 4
_HELD_OUT_RATIO, _EMPTY_SHARE = 1.5, 0.2


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
    square_mm: Annotated[float, typer.Option("--square-mm", help="charuco: measured.")] = 30.0,
    marker_mm: Annotated[float, typer.Option("--marker-mm", help="charuco: measured.")] = 22.0,
    tags: Annotated[str, typer.Option(help="tags: columns x rows of tags.")] = "4x3",
    size_mm: Annotated[float, typer.Option("--size-mm", help="tags: measured.")] = 30.0,
    gap_mm: Annotated[float, typer.Option("--gap-mm", help="tags: measured.")] = 7.5,
    first_id: Annotated[int, typer.Option(help="tags: id of the first one.")] = 0,
    dictionary: Annotated[
        str | None, typer.Option(help="Of the markers; charuco 5x5_100, tags 36h11.")
    ] = None,
    distortion: Annotated[int, typer.Option(help="Numbers of distortion: 0, 4, 5 or 8.")] = 4,
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
    tag_mm: Annotated[float, typer.Option("--tag-mm", help="Tag size of the report.")] = 25.0,
    out: Annotated[Path, typer.Option(help="Folder for the camera files.")] = Path("intrinsics"),
    json_to: JsonOption = None,
) -> None:
    """Calibrate a camera from pictures of a board; writes OpenCV, ROS and cell file intrinsics."""
    from vgrd.vision.intrinsics.effect import effect_on_coordinates
    from vgrd.vision.intrinsics.estimate import calibrate_intrinsics
    from vgrd.vision.intrinsics.pictures import read_board_pictures

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
    at = distance_mm or float(np.median([r.distance_mm for r in result.reports if r.distance_mm]))
    effect = effect_on_coordinates(result.camera, result.covariance, at, tag_mm)
    told = _to_json(result, pictures)
    told |= {"effect": asdict(effect), "files": _write(out, result)}
    print_result(told, json_to, _show)


def _to_json(result: "IntrinsicsResult", pictures: "BoardPictures") -> dict[str, object]:
    unusable = [
        {"name": name, "used": False, "reason": why} for name, why in pictures.unusable.items()
    ]
    return {
        **_camera_json(result.camera),
        "sigma": result.sigmas,
        "covariance": result.covariance.tolist(),
        "rms_px": result.rms_px,
        "held_out_px": result.held_out_px,
        "noise": asdict(result.bundle.noise),
        "pictures": [*(asdict(report) for report in result.reports), *unusable],
        "findings": _findings(result),
    }


def camera(
    source: Annotated[Path, typer.Argument(help="OpenCV, ROS camera_info, Kalibr or cell file.")],
    out: Annotated[
        Path | None, typer.Option(help="Write .toml, or OpenCV's .yaml, .xml, .json.")
    ] = None,
    ros: Annotated[bool, typer.Option("--ros", help="Write ROS camera_info instead.")] = False,
    json_to: JsonOption = None,
) -> None:
    """Show the intrinsics in a camera file, and convert them."""
    from vgrd.vision.intrinsics.camera_files import Kind, read_camera, write_camera

    found = read_camera(source)
    if out is not None:
        kind: Kind = "ros" if ros else "toml" if out.suffix.lower() == ".toml" else "opencv"
        write_camera(out, found, kind, out.stem)
    print_result(_camera_json(found), json_to, show_fields(str(source)))


def _check_views(pictures: "BoardPictures") -> None:
    from vgrd.vision.intrinsics.estimate import MIN_VIEWS

    if len(pictures.views) < MIN_VIEWS:
        why = "".join(f"\n  {name}: {reason}" for name, reason in pictures.unusable.items())
        raise InputError(
            f"the board is in {len(pictures.views)} pictures, at least {MIN_VIEWS} are needed "
            f"(20 are good); do --board and its sizes fit?{why}"
        )


def _camera_json(found: "CameraModel") -> dict[str, object]:
    K = found.matrix
    return {
        "matrix": [float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])],
        "distortion": found.distortion.tolist(),
        "size_px": list(found.size_px),
    }


def _write(out: Path, result: "IntrinsicsResult") -> list[str]:
    from vgrd.vision.images.drawing import write_picture
    from vgrd.vision.intrinsics.camera_files import write_camera
    from vgrd.vision.intrinsics.pictures import draw_coverage

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be made: {error.strerror}") from error
    write_camera(out / "camera.yaml", result.camera, "opencv")
    write_camera(out / "camera_info.yaml", result.camera, "ros")
    write_camera(out / "camera.toml", result.camera, "toml")
    write_picture(out / "coverage.png", draw_coverage(result))
    names = ("camera.yaml", "camera_info.yaml", "camera.toml", "coverage.png")
    return [str(out / name) for name in names]


def _findings(result: "IntrinsicsResult") -> list[dict[str, str]]:
    """What the operator could do better, most important first."""
    from vgrd.vision.intrinsics.pictures import coverage

    used = [report for report in result.reports if report.used]
    tilted = sum((report.tilt_deg or 0) > _TILTED_DEG for report in used)
    empty = float(np.mean(coverage(result.views, result.camera.size_px) == 0))
    found = []
    if tilted < _LEAST_TILTED:
        found.append(
            (
                "frontal",
                f"only {tilted} pictures show the board tilted by more than 15 degrees: tilt it",
            )
        )
    if len(used) < _FEW_PICTURES:
        found.append(("few_pictures", f"{len(used)} pictures used: 20 are good"))
    if empty > _EMPTY_SHARE:
        found.append(
            ("coverage", f"{empty:.0%} of the picture never saw the board: see coverage.png")
        )
    if result.held_out_px > _HELD_OUT_RATIO * result.rms_px:
        found.append(
            (
                "held_out",
                f"pictures left out are off by {result.held_out_px:.3g} px, those of the fit by "
                f"{result.rms_px:.3g}: take more pictures",
            )
        )
    return [{"code": code, "message": message} for code, message in found]


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
