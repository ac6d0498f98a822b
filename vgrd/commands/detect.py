"""The command that finds tags and boards in pictures and says how good they are."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.boards import CameraNameOption, board_in_file
from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.geometry.camera import CameraModel
    from vgrd.vision.boards.fit import MeasurableBoard

Lens = tuple[Path, str | None]  # camera file, which camera of it
_DEFAULT_DICTIONARY = "36h11"

_BOARD_COLUMNS = ("board", "sigma px", "misfit px", "x, y, z mm", "1 sigma mm", "quality")
_TAG_COLUMNS = ("dictionary", "id", "px", "sigma px", "tilt deg", "x, y, z mm", "quality")


def register(app: typer.Typer) -> None:
    """Add detect."""
    app.command()(detect)


def detect(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Pictures.")],
    dictionary: Annotated[
        list[str] | None,
        typer.Option(
            help="AprilTag family or ArUco dictionary of single tags; may be repeated. Default: 36h11, "
            "with --board none."
        ),
    ] = None,
    size_mm: Annotated[
        float | None, typer.Option("--size-mm", help="Edge of the tags' black square, measured.")
    ] = None,
    board: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE.toml",
            help="Board file, as for intrinsics; may be repeated. Needs --camera.",
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Camera file: whatever vgrd camera reads.")
    ] = None,
    camera_name: CameraNameOption = None,
    draw: Annotated[
        Path | None, typer.Option(help="Folder for pictures with what was found.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Find tags in pictures: corners, quality, and with --size-mm and --camera their poses.

    With --board and --camera the poses of whole boards, each measured as one target.
    """
    from vgrd.vision.print.codes import detectable_family

    if size_mm is not None and not size_mm > 0:
        raise InputError(f"--size-mm {size_mm:g}: give the edge of the black square in mm")
    only_boards = board and not dictionary and size_mm is None
    names = [] if only_boards else dictionary or [_DEFAULT_DICTIONARY]
    families = list(dict.fromkeys(detectable_family(name) for name in names))
    if board and camera is None:
        raise InputError(
            "--board needs --camera: a board is measured through a known lens; "
            "vgrd intrinsics makes the camera file from pictures of the board"
        )
    boards = {str(path): _measurable(path) for path in board or ()}
    lens = None if camera is None else (camera, camera_name)
    if lens is not None:
        _camera_of(lens, (1, 1))  # a fault of the file is told once, not for every picture
    rows, failures = [], []
    for image, drawn in zip(images, _drawn_files(images, draw), strict=True):
        try:
            rows.append(_one(image, families, size_mm, lens, boards, drawn))
        except InputError as error:
            failures.append(str(error))
            told = [_failure(image, error)]
            rows.append({"file": str(image), "boards": [], "tags": [], "findings": told})
    print_result({"images": rows}, json_to, _show)
    if failures:
        raise InputError("\n".join(failures))


def _one(
    image: Path,
    families: list[str],
    size_mm: float | None,
    lens: Lens | None,
    boards: Mapping[str, "MeasurableBoard"],
    drawn: Path | None,
) -> dict[str, object]:
    from vgrd.vision.images.pictures import read_picture
    from vgrd.vision.inspection import inspect_picture
    from vgrd.vision.overlays import write_overlays

    picture = read_picture(image)
    height, width = picture.pixels.shape
    camera = None if lens is None else _camera_of(lens, (width, height))
    if lens is not None and camera is not None and camera.size_px != (width, height):
        raise InputError(
            f"{image}: has {width} x {height} px, the camera of {lens[0]} has "
            f"{camera.size_px[0]} x {camera.size_px[1]}: give the camera file of this picture"
        )
    report = inspect_picture(picture, families, size_mm, camera, boards)
    if drawn is not None:
        write_overlays(drawn, picture, report)
    return {"file": str(image), "width": width, "height": height} | report.to_json()


def _measurable(path: Path) -> "MeasurableBoard":
    from vgrd.vision.print.boards import Charuco
    from vgrd.vision.print.targets import TagGrid

    board = board_in_file(path)
    if not isinstance(board, Charuco | TagGrid):
        raise InputError(
            f"--board {path}: poses are measured of ChArUco boards and boards of tags; "
            "vgrd target draws both"
        )
    return board


def _camera_of(lens: Lens, size_px: tuple[int, int]) -> "CameraModel":
    from vgrd.vision.intrinsics.camera_files import read_camera

    path, name = lens
    return read_camera(path, size_px, name)


def _drawn_files(images: Sequence[Path], folder: Path | None) -> Sequence[Path | None]:
    """Where each picture is drawn; pictures of one name from several folders are numbered."""
    if folder is None:
        return [None] * len(images)
    from vgrd.vision.images.drawing import folder_for_pictures

    folder_for_pictures(folder)
    stems = Counter(image.stem for image in images)
    return [
        folder / (f"{image.stem}-{i + 1}.png" if stems[image.stem] > 1 else f"{image.stem}.png")
        for i, image in enumerate(images)
    ]


def _failure(image: Path, error: InputError) -> dict[str, str]:
    return {"code": "not_used", "message": str(error).removeprefix(f"{image}: ")}


def _show(result: Result) -> None:
    from vgrd.vision.inspection import remarks

    for image in result["images"]:
        size = f" ({image['width']} x {image['height']} px)" if "width" in image else ""
        title = f"{image['file']}{size}"
        if image["boards"]:
            console.print(table(title, _BOARD_COLUMNS, list(map(_board_row, image["boards"]))))
        if image["tags"]:
            console.print(table(title, _TAG_COLUMNS, list(map(_row, image["tags"]))))
        if not (image["boards"] or image["tags"]):
            console.print(title, highlight=False, markup=False)
        findings = [f for part in (*image["boards"], image) for f in part["findings"]]
        of_tags = [f for tag in image["tags"] for f in tag["quality"]["findings"]]
        for remark in (*remarks(of_tags), *(f["message"] for f in findings)):
            console.print(f"  {remark}", highlight=False, markup=False)


def _board_row(board: Result) -> list[object]:
    sigma, misfit = board.get("corner_sigma_px"), board.get("misfit_px")
    pose, at = board.get("camera_from_board"), board.get("origin_sigma_mm")
    return [
        Path(board["board"]).stem,
        None if sigma is None else f"{sigma:.2g}",
        None if misfit is None else f"{misfit:.2g}",
        None if pose is None else [row[3] for row in pose[:3]],
        None if at is None else f"{at:.2g}",
        ", ".join(finding["code"] for finding in board["findings"]) or "good",
    ]


def _row(tag: Result) -> list[object]:
    quality = tag["quality"]
    tilt = quality.get("tilt_deg")
    pose = tag.get("camera_from_tag")
    return [
        tag["dictionary"],
        tag["id"],
        round(quality["side_px"]),
        f"{quality['corner_sigma_px']:.2g}",
        None if tilt is None else f"{tilt:.1f}",
        None if pose is None else [row[3] for row in pose[:3]],
        ", ".join(finding["code"] for finding in quality["findings"]) or "good",
    ]
