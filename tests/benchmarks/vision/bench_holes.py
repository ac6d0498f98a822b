"""p_f: the centre of a 12 mm hole in a known plane, against the Cramer-Rao bound of the same pictures.

12 MP, 0.047 mm/px at 600 mm, 40 dB; unknown in the bound: centre, radius, both levels and blur. Peer: the centre of
an ellipse through the hole's outline (OpenCV's fitEllipseAMS), mapped to the plane.
"""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from fakes.camera.patterns import Disc
from fakes.camera.pictures import Look, Placed, RegionPicture, clean_levels, draw, pinhole
from fakes.world.optics import Optics
from tests.benchmarks.harness import Row
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.holes.hole_finder import HoleObservation, find_hole

POSES, BOUNDS = 300, 8
TILTS_DEG = (0, 20, 40, 60)
RADIUS_MM = 6.0
DISTORTION = np.array([-0.08, 0.10, 2e-4, -1e-4, 0.0])
MATRIX = np.array([[12766.0, 0, 2014.8], [0, 12766.0, 1511.8], [0, 0, 1]])
CAMERA = pinhole(MATRIX, DISTORTION, (4024, 3036))
LOOK = Look()
WORST_MM, WORST_RATIO = 0.0005, 2.0
NEES = 2.0


def rows() -> Iterator[Row]:
    """hole_mm and hole_vs_bound for every tilt, hole_nees over all."""
    nees: list[float] = []
    for tilt in TILTS_DEG:
        rng = np.random.default_rng(100 + tilt)
        errors: list[Array] = []
        ellipses: list[Array] = []
        bounds: list[float] = []
        for pose, picture in _pictures(rng, tilt):
            found = _find(picture, pose, rng)
            errors.append(found.center_in_plane)
            nees.append(_squared(found))
            ellipses.append(_ellipse_centre(picture, pose))
            if len(bounds) < BOUNDS:
                bounds.append(_bound(pose, picture))
        rmse = _rms(errors)
        bound = float(np.sqrt(np.mean(bounds)))
        note = f"bound {1e6 * bound:.0f} nm, centre of the ellipse {_rms(ellipses):.4f} mm"
        yield Row.at_most(f"hole_mm_tilt_{tilt}", rmse, "mm", WORST_MM, note)
        yield Row.at_most(f"hole_vs_bound_tilt_{tilt}", rmse / bound, "x", WORST_RATIO, note)
    off = abs(float(np.mean(nees)) / NEES - 1)
    note = f"mean NEES {np.mean(nees):.3f} of {len(nees)}, dimension 2"
    yield Row.at_most("hole_nees_off", off, "", 0.1, note)


def _pictures(rng: np.random.Generator, tilt_deg: float) -> Iterator[tuple[Pose, RegionPicture]]:
    for _ in range(POSES):
        about, yaw = rng.uniform(0, 2 * np.pi, 2)
        axis = np.radians(tilt_deg) * np.array([np.cos(about), np.sin(about), 0.0])
        place = (*rng.uniform((-55, -40), (55, 40)), 600.0)
        pose = Pose.from_rotvec(axis, place) @ Pose.from_rotvec((0.0, 0.0, yaw))
        yield pose, draw(CAMERA, [_hole(pose)], LOOK, seed=rng, margin_px=30.0)


def _hole(pose: Pose, centre: Array | None = None, radius: float = RADIUS_MM) -> Placed:
    return Placed(Disc(np.zeros(2) if centre is None else centre, radius), pose)


def _model(camera: Optics) -> CameraModel:
    return CameraModel(camera.matrix, DISTORTION, camera.size_px)


def _find(picture: RegionPicture, pose: Pose, rng: np.random.Generator) -> HoleObservation:
    guess = rng.uniform(-0.3, 0.3, 2)
    return find_hole(
        picture.pixels, _model(picture.camera), pose, RADIUS_MM, guess,
        search_mm=0.5, rim_height_sigma_mm=0.0,
    )  # fmt: skip


def _squared(found: HoleObservation) -> float:
    error = found.center_in_plane
    return float(error @ np.linalg.solve(found.covariance, error))


def _ellipse_centre(picture: RegionPicture, pose: Pose) -> Array:
    """Where the peer believes the centre to be, (2,) mm in the plane."""
    _, dark = cv2.threshold(picture.pixels, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    outlines, _ = cv2.findContours(dark, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    centre = cv2.fitEllipseAMS(max(outlines, key=cv2.contourArea))[0]
    ray = np.append(_model(picture.camera).normalize([centre])[0], 1.0)
    plane = np.column_stack([pose.rotation[:, :2], pose.translation])
    x, y, z = np.linalg.solve(plane, ray)
    return np.array([x / z, y / z])


def _bound(pose: Pose, picture: RegionPicture) -> float:
    """Cramer-Rao bound of the squared error of the centre, mm^2."""

    def levels(
        x: float = 0.0,
        y: float = 0.0,
        grow: float = 0.0,
        around: float = LOOK.around,
        black: float = LOOK.black,
        psf_px: float = LOOK.psf_px,
    ) -> Array:
        hole = _hole(pose, np.array([x, y]), RADIUS_MM + grow)
        changed = replace(LOOK, around=around, black=black, psf_px=psf_px)
        clean = clean_levels(CAMERA, [hole], changed, region=picture.region)[0]
        return clean.ravel().astype(np.float64)

    h = 0.002
    columns = [
        (levels(**{key: middle + step}) - levels(**{key: middle - step})) / (2 * step)
        for key, middle, step in (
            ("x", 0.0, h), ("y", 0.0, h), ("grow", 0.0, h), ("around", LOOK.around, 0.01),
            ("black", LOOK.black, 1.0), ("psf_px", LOOK.psf_px, 0.02),
        )
    ]  # fmt: skip
    J = np.stack(columns, 1)
    variance = LOOK.shot * levels() + LOOK.read**2 + 1 / 12
    information = (J / variance[:, None]).T @ J
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return float(covariance[0, 0] + covariance[1, 1])


def _rms(errors: list[Array]) -> float:
    """Root mean square of 2D errors."""
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))
