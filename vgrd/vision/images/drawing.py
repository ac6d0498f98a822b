"""Pictures for people: detections, residual maps and hole fits drawn over what the camera saw.

All functions take grey pictures (h, w), uint8 or uint16, and pixels in OpenCV's convention (centre of
the first pixel at 0, 0), and return colour pictures (h, w, 3) uint8 in OpenCV's order blue, green, red.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Pixels
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.images.pictures import as_8_bit

Colour = NDArray[np.uint8]
Bgr = tuple[int, int, int]

GOOD: Bgr = (60, 180, 40)  # green
DOUBTFUL: Bgr = (20, 140, 255)  # orange
BLUE: Bgr = (220, 120, 20)  # a guess: lighter than pure blue, which is lost on dark pictures
RED: Bgr = (40, 40, 220)  # as bright as BLUE: both are ends of one scale
_AXES: tuple[Bgr, Bgr, Bgr] = ((60, 60, 230), (60, 190, 60), (230, 120, 40))  # x, y, z
_GREY: Bgr = (128, 128, 128)  # of no value: on no scale from blue over white to red
_SHIFT = 4  # OpenCV draws with this many bits of a pixel's fraction
_BAR_PX = 46  # of the scale of residuals: half of it the colours, twice of it the numbers
_LETTERS_PX = 30  # a line of OpenCV's letters at scale 1


@dataclass(frozen=True, slots=True, eq=False)
class TagMark:
    """A tag to draw: corners_px (4, 2); axes_px (4, 2): origin and the ends of x, y, z, or None."""

    label: str
    corners_px: Array
    axes_px: Array | None = None
    doubtful: bool = False


def axes_px(camera: CameraModel, camera_from_tag: Pose, length_mm: float) -> Array:
    """Pixels (4, 2) of a frame's origin and of the ends of its axes; NaN for what is not in front."""
    tips = np.vstack([np.zeros(3), length_mm * np.eye(3)])
    return camera.project(camera_from_tag @ tips)


def draw_tags(picture: Pixels, marks: Sequence[TagMark]) -> Colour:
    """The picture with each tag's outline, its first corner, label and axes; nothing hides a corner."""
    drawing = in_colour(picture)
    for mark in marks:
        side = float(np.linalg.norm(np.ptp(mark.corners_px, axis=0))) / 1.4
        thickness = max(1, round(min(side / 80, _line(drawing))))
        colour = DOUBTFUL if mark.doubtful else GOOD
        cv2.polylines(
            drawing, [_fixed(mark.corners_px)], True, colour, thickness, cv2.LINE_AA, _SHIFT
        )
        first = mark.corners_px[:1]
        circle_at(drawing, first[0], max(side / 25, 2.0), RED, thickness)
        if mark.axes_px is not None and np.isfinite(mark.axes_px).all():
            for tip, axis in zip(mark.axes_px[1:], _AXES, strict=True):
                line = _fixed(np.array([mark.axes_px[0], tip]))
                cv2.polylines(drawing, [line], False, axis, thickness + 1, cv2.LINE_AA, _SHIFT)
        low = mark.corners_px.min(0) - np.array([0, 0.15 * side + 4])
        _label(drawing, mark.label, low, max(min(0.22 * side, 10 * _line(drawing)), 9.0), colour)
    return drawing


def draw_residuals(picture: Pixels, residuals: Array, limit: float, unit: str) -> Colour:
    """Map of picture minus model, blue to red at -limit to limit, beside what was seen.

    residuals: (h, w) like the picture, NaN where nothing was compared; unit: of the numbers.
    """
    if residuals.shape != picture.shape:
        raise InputError(
            f"residuals {residuals.shape} of a picture {picture.shape}: crop them alike"
        )
    scale = max(1, round(360 / max(picture.shape)))
    photo = _enlarged(in_colour(picture), scale)
    residual_map = _enlarged(_diverging(residuals / limit), scale)
    bar = _diverging(np.linspace(1, -1, photo.shape[0])[:, None].repeat(_BAR_PX // 2, axis=1))
    gap = np.full((photo.shape[0], 8, 3), 255, np.uint8)
    scale_text = np.full((photo.shape[0], 2 * _BAR_PX, 3), 255, np.uint8)
    drawing = np.hstack([photo, gap, residual_map, gap, bar, scale_text])
    left = drawing.shape[1] - 2 * _BAR_PX + 4
    for text, y in ((f"{limit:+.3g}", 14), (f"{-limit:+.3g}", photo.shape[0] - 6)):
        _write(drawing, text, (left, y), 12)
    _write(drawing, unit, (left, photo.shape[0] // 2 + 6), 12)
    return drawing


def draw_hole(
    picture: Pixels,
    rim_px: Array,
    outline_px: Array,
    center_px: Array,
    label: str,
    colour: Bgr = GOOD,
) -> Colour:
    """A hole enlarged: edge points (n, 2) that were used, fitted outline (m, 2), centre (2,)."""
    low = np.floor(outline_px.min(0) - 0.25 * np.ptp(outline_px, axis=0).max()).astype(int)
    high = np.ceil(outline_px.max(0) + 0.25 * np.ptp(outline_px, axis=0).max()).astype(int)
    x0, y0 = np.maximum(low, 0).tolist()
    x1, y1 = np.minimum(high + 1, picture.shape[::-1]).tolist()
    if x1 - x0 < 2 or y1 - y0 < 2:
        raise InputError("the hole is outside the picture")
    scale = max(1, round(700 / max(x1 - x0, y1 - y0)))
    drawing = _enlarged(in_colour(picture[y0:y1, x0:x1]), scale)

    def place(points: Array) -> Array:
        return np.asarray((points - [x0, y0] + 0.5) * scale - 0.5)

    cv2.polylines(drawing, [_fixed(place(outline_px))], True, colour, 1, cv2.LINE_AA, _SHIFT)
    for point in place(rim_px):
        circle_at(drawing, point, 2.0, BLUE, 1)
    center = place(center_px[None])[0]
    for arm in (np.array([9.0, 0]), np.array([0, 9.0])):
        cross = _fixed(np.array([center - arm, center + arm]))
        cv2.polylines(drawing, [cross], False, RED, 1, cv2.LINE_AA, _SHIFT)
    _label(drawing, label, np.array([6.0, 26.0]), 18, colour)
    return drawing


def in_colour(picture: Pixels) -> Colour:
    """A grey picture as a colour one to draw on."""
    return np.asarray(cv2.cvtColor(as_8_bit(picture), cv2.COLOR_GRAY2BGR), np.uint8)


def circle_at(
    drawing: Colour, center_px: Array, radius_px: float, colour: Bgr, thickness: int
) -> None:
    """Draw a circle at a fraction of a pixel."""
    x, y = _fixed(center_px[None])[0, 0].tolist()
    radius = round(radius_px * (1 << _SHIFT))
    cv2.circle(drawing, (x, y), radius, colour, thickness, cv2.LINE_AA, _SHIFT)


def folder_for_pictures(folder: Path) -> Path:
    """The folder, made where it is missing; InputError when that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--draw {folder}: cannot be made: {error.strerror}") from error
    return folder


def write_picture(path: Path, picture: Colour | Pixels) -> None:
    """Write a PNG or JPEG; InputError when that cannot be."""
    try:
        is_encoded, data = cv2.imencode(path.suffix, picture)
    except cv2.error as error:
        raise InputError(f"{path}: cannot write pictures of this kind, use .png") from error
    try:
        path.write_bytes(data.tobytes() if is_encoded else b"")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _diverging(values: Array) -> Colour:
    """Blue, white, red for -1, 0, 1; grey for NaN."""
    v = np.nan_to_num(values.clip(-1, 1))[..., None]
    white, red, blue = np.array([250.0] * 3), np.array(RED), np.array(BLUE)
    colours = white + np.where(v > 0, v * (red - white), -v * (blue - white))
    return np.where(np.isnan(values)[..., None], np.array(_GREY), colours).astype(np.uint8)


def _enlarged(picture: Colour, scale: int) -> Colour:
    return picture.repeat(scale, axis=0).repeat(scale, axis=1)


def _line(drawing: Colour) -> float:
    return float(max(drawing.shape[:2])) / 600


def _fixed(points: Array) -> NDArray[np.int32]:
    return np.rint(points * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)


def _label(drawing: Colour, text: str, place: Array, height_px: float, colour: Bgr) -> None:
    """Text on a dark plate, moved so that it stays inside the picture."""
    scale = height_px / _LETTERS_PX
    thickness = max(1, round(scale * 1.6))
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thickness)
    x = int(np.clip(place[0], 0, max(drawing.shape[1] - width - 2, 0)))
    y = int(np.clip(place[1], height + 2, max(drawing.shape[0] - below - 2, height + 2)))
    cv2.rectangle(drawing, (x - 2, y - height - 3), (x + width + 2, y + below), (30, 30, 30), -1)
    cv2.putText(
        drawing, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thickness, cv2.LINE_AA
    )


def _write(drawing: Colour, text: str, place: tuple[int, int], height_px: float) -> None:
    scale = height_px / _LETTERS_PX
    cv2.putText(drawing, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), 1, cv2.LINE_AA)
