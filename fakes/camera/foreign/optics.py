"""Lens and pixel: a sheet warped to a fine grid, spread by a point spread of any shape, and summed."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from fakes.camera.foreign.sheet import Sheet
from vgrd.geometry import Array, Pose

_FINE = 5  # samples of the scene along one pixel
_GOLDEN = 0.6180339887498949  # low discrepancy: samples of neighbouring rows interleave
Spread = Callable[[Array, Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A part of the picture: its first pixel (x, y) and its size (width, height)."""

    x: int
    y: int
    width: int
    height: int


def disc(radius_px: float) -> Spread:
    """Defocus by a round aperture."""
    return lambda x, y: np.clip((radius_px - np.hypot(x, y)) * _FINE + 0.5, 0, 1)


def moffat(fwhm_px: float, beta: float) -> Spread:
    """A lens that scatters: a core with wide wings."""
    core = fwhm_px / (2 * np.sqrt(2 ** (1 / beta) - 1))
    return lambda x, y: (1 + (x * x + y * y) / core**2) ** -beta


def bell(sigma_px: float) -> Spread:
    """A Gaussian."""
    return lambda x, y: np.exp(-(x * x + y * y) / (2 * sigma_px**2))


def streak(length_px: float, angle_rad: float, sigma_px: float) -> Spread:
    """A Gaussian that is dragged along a line."""
    steps = (np.arange(16) + 0.5) / 16 - 0.5
    shifts = [
        (length_px * s * np.cos(angle_rad), length_px * s * np.sin(angle_rad)) for s in steps
    ]
    still = bell(sigma_px)
    return lambda x, y: np.asarray(sum(still(x - a, y - b) for a, b in shifts))


def projected(
    sheet: Sheet,
    camera_from_tag: Pose,
    matrix: Array,
    window: Window,
    spread: Spread | None,
    reach_px: float,
) -> Array:
    """Share of light (height, width) of the pixels of a window, from a camera without distortion.

    spread: None for a lens that is sharper than its pixels; reach_px: how far it is felt.
    """
    rim = int(np.ceil(reach_px))
    wide, high = (_FINE * (size + 2 * rim) for size in (window.width, window.height))
    # Samples interleave from row to row and column to column, so that an edge is not cut in steps.
    i, j = np.arange(wide), np.arange(high)
    ahead_x, ahead_y = ((_GOLDEN * k) % 1 - 0.5 for k in (j, i))
    u = window.x - rim - 0.5 + (i[None, :] + 0.5 + ahead_x[:, None]) / _FINE
    v = window.y - rim - 0.5 + (j[:, None] + 0.5 + ahead_y[None, :]) / _FINE
    plane = matrix @ np.column_stack(
        [
            camera_from_tag.rotation[:, 0],
            camera_from_tag.rotation[:, 1],
            camera_from_tag.translation,
        ]
    )
    G = sheet.sheet_from_tag @ np.linalg.inv(plane)
    w = G[2, 0] * u + G[2, 1] * v + G[2, 2]
    x = ((G[0, 0] * u + G[0, 1] * v + G[0, 2]) / w).astype(np.float32)
    y = ((G[1, 0] * u + G[1, 1] * v + G[1, 2]) / w).astype(np.float32)
    scene = cv2.remap(sheet.reflectance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if spread is not None:
        half = int(np.ceil(reach_px * _FINE))
        at = np.arange(-half, half + 1) / _FINE
        kernel = spread(*np.meshgrid(at, at))
        kernel = (kernel / kernel.sum()).astype(np.float32)
        scene = cv2.filter2D(scene, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    pixels = cv2.resize(scene, (wide // _FINE, high // _FINE), interpolation=cv2.INTER_AREA)
    return np.asarray(pixels[rim : rim + window.height, rim : rim + window.width])
