"""The command that finds tags in pictures and says how good they are."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.errors import InputError
from vgrd.printing import JsonOption, Result, console, print_result, table

if TYPE_CHECKING:
    from vgrd.geometry.camera import CameraModel
    from vgrd.vision.inspecting import PictureReport
    from vgrd.vision.pictures import Picture

_DEFAULT_DICTIONARY = "36h11"
_RESIDUAL_SIGMAS = 5.0  # that are shown in full colour


def register(app: typer.Typer) -> None:
    """Add detect."""
    app.command()(detect)


def detect(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Pictures.")],
    dictionary: Annotated[
        list[str] | None,
        typer.Option(help="AprilTag family or ArUco dictionary; may be repeated. Default: 36h11."),
    ] = None,
    size_mm: Annotated[
        float | None, typer.Option("--size-mm", help="Edge of the tags' black square, measured.")
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Camera file: OpenCV, ROS camera_info or a cell file.")
    ] = None,
    draw: Annotated[
        Path | None, typer.Option(help="Folder for pictures with what was found.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Find tags in pictures: corners, quality, and with --size-mm and --camera their poses."""
    from vgrd.vision.codes import family_named

    if size_mm is not None and not size_mm > 0:
        raise InputError(f"--size-mm {size_mm:g}: give the edge of the black square in mm")
    families = [family_named(name) for name in dictionary or [_DEFAULT_DICTIONARY]]
    if camera is not None:
        _camera_of(camera, (1, 1))  # a fault of the file is told once, not for every picture
    rows, failures = [], []
    for image, drawn in zip(images, _drawn_files(images, draw), strict=True):
        try:
            rows.append(_one(image, list(dict.fromkeys(families)), size_mm, camera, drawn))
        except InputError as error:
            failures.append(str(error))
            rows.append({"file": str(image), "tags": [], "findings": [_failure(image, error)]})
    print_result({"images": rows}, json_to, _show)
    if failures:
        raise InputError("\n".join(failures))


def _one(
    image: Path,
    families: list[str],
    size_mm: float | None,
    camera_file: Path | None,
    drawn: Path | None,
) -> dict[str, object]:
    from vgrd.vision.inspecting import inspect_picture
    from vgrd.vision.pictures import read_picture

    picture = read_picture(image)
    height, width = picture.pixels.shape
    camera = None if camera_file is None else _camera_of(camera_file, (width, height))
    if camera is not None and camera.size_px != (width, height):
        raise InputError(
            f"{image}: has {width} x {height} px, the camera of {camera_file} has "
            f"{camera.size_px[0]} x {camera.size_px[1]}: give the camera file of this picture"
        )
    report = inspect_picture(picture, families, size_mm, camera)
    if drawn is not None:
        _draw(drawn, picture, report)
    return {"file": str(image), "width": width, "height": height} | report.to_json()


def _camera_of(path: Path, size_px: tuple[int, int]) -> "CameraModel":
    from vgrd.vision.camera_files import read_camera

    return read_camera(path, size_px)


def _drawn_files(images: Sequence[Path], folder: Path | None) -> Sequence[Path | None]:
    """Where each picture is drawn; pictures of one name from several folders are numbered."""
    if folder is None:
        return [None] * len(images)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--draw {folder}: cannot be made: {error.strerror}") from error
    stems = Counter(image.stem for image in images)
    return [
        folder / (f"{image.stem}-{i + 1}.png" if stems[image.stem] > 1 else f"{image.stem}.png")
        for i, image in enumerate(images)
    ]


def _draw(path: Path, picture: "Picture", report: "PictureReport") -> None:
    from vgrd.vision.drawing import draw_residuals, draw_tags, write_picture

    write_picture(path, draw_tags(picture.pixels, report.marks()))
    for number, tag in enumerate(report.tags):
        found = tag.residual_map(picture.pixels.shape)
        if found is not None:
            region, residuals = found
            drawn = draw_residuals(picture.pixels[region], residuals, _RESIDUAL_SIGMAS, "sigma")
            name = f"{path.stem}-{number}-tag{tag.found.id}.png"
            write_picture(path.with_name(name), drawn)


def _failure(image: Path, error: InputError) -> dict[str, str]:
    return {"code": "not_used", "message": str(error).removeprefix(f"{image}: ")}


def _show(result: Result) -> None:
    for image in result["images"]:
        size = f" ({image['width']} x {image['height']} px)" if "width" in image else ""
        rows = [_row(tag) for tag in image["tags"]]
        columns = ("dictionary", "id", "px", "sigma px", "tilt deg", "x, y, z mm", "quality")
        if rows:
            console.print(table(f"{image['file']}{size}", columns, rows))
        else:
            console.print(f"{image['file']}{size}", highlight=False, markup=False)
        for remark in (*_remarks(image["tags"]), *(f["message"] for f in image["findings"])):
            console.print(f"  {remark}", highlight=False, markup=False)


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


def _remarks(tags: list[Result]) -> Iterator[str]:
    """What to do about each kind of finding, told once, for the first tag that has it."""
    told = Counter(f["code"] for tag in tags for f in tag["quality"]["findings"])
    for tag in tags:
        for finding in tag["quality"]["findings"]:
            others = told.pop(finding["code"], 0) - 1
            if others >= 0:
                also = f" (and {others} more)" if others else ""
                yield f"{finding['code']}: {finding['message']}{also}"
