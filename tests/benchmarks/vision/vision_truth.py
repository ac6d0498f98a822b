"""Truth for the benchmarks of vision: cameras, random poses, pictures, and the bound of Cramer and Rao."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fakes.camera.patterns import Figure
from fakes.camera.pictures import Look, Placed, clean_levels, draw, pinhole
from fakes.camera.sensor import PixelRegion
from fakes.world.optics import Optics
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.alignment.refinement import Refined, refine
from vgrd.vision.images.warp import lens_vector
from vgrd.vision.print.raster import Raster
from vgrd.vision.tags.planar_pose import PlanarPose, planar_poses

DISTORTION = np.array([-0.08, 0.10, 2e-4, -1e-4])
DEPTH_MM = 600.0
ROUGH_PX = 0.7  # error of the corners that a fit starts from


def camera_of(focal_px: float, size_px: tuple[int, int]) -> Optics:
    """A camera with the study's distortion, its axis a little off the middle."""
    x, y = (size_px[0] - 1) / 2 + 3.3, (size_px[1] - 1) / 2 - 5.7
    return pinhole(np.array([[focal_px, 0, x], [0, focal_px, y], [0, 0, 1]]), DISTORTION, size_px)


NARROW = camera_of(12766.0, (4024, 3036))  # 12 MP, 0.047 mm/px at 600 mm
WIDE = camera_of(2400.0, (2448, 2048))  # 5 MP, 0.25 mm/px


def random_pose(
    camera: Optics, rng: np.random.Generator, tilt_deg: float, spread: float = 0.6
) -> Pose:
    """Tilted by `tilt_deg` from the line of sight about a random axis, turned and placed at random."""
    azimuth, turn = rng.uniform(0, 2 * np.pi, 2)
    lean = Pose.from_rotvec(np.radians(tilt_deg) * np.array([np.cos(azimuth), np.sin(azimuth), 0]))
    middle = np.array(camera.size_px) / 2
    pixel = middle + rng.uniform(-0.5, 0.5, 2) * spread * np.array(camera.size_px)
    x, y = camera.rays(pixel)
    sight = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
    axis = np.cross([0.0, 0.0, 1.0], sight)
    sine = float(np.linalg.norm(axis))
    view = Pose.from_rotvec(axis / max(sine, 1e-12) * np.arcsin(sine))
    rotation = (view @ lean @ Pose.from_rotvec((0, 0, turn))).rotation
    return Pose(rotation, np.array([x, y, 1.0]) * DEPTH_MM)


@dataclass(frozen=True)
class Shot:
    """A picture of one figure: pixels, and the camera that sees only it."""

    pixels: np.ndarray
    camera: CameraModel


def shot(
    camera: Optics, figure: Figure, pose: Pose, seed: np.random.Generator, look: Look | None = None
) -> Shot:
    """Draw one figure."""
    picture = draw(camera, [Placed(figure, pose)], look, seed=seed)
    own = picture.camera
    return Shot(picture.pixels, CameraModel(own.matrix, own.distortion, own.size_px))


def corner_bound(
    camera: Optics, figure: Figure, pose: Pose, corners: Array, inside: Array
) -> Array:
    """Smallest covariance (8, 8) px^2 of the corners (4, 3) mm of any unbiased estimate of the pose.

    From renderings at displaced poses, so independent of the estimator's model; unknown besides the
    pose: planes of white and of black, the blur. inside: (2, 2) corners, mm, of what is used.
    """
    look = Look()
    levels, region = clean_levels(camera, [Placed(figure, pose)], look)

    def seen(moved: Pose, changed: Look) -> Array:
        return clean_levels(camera, [Placed(figure, moved)], changed, region=region)[0].ravel()

    size = float(np.ptp(corners[:, 0])) / 2
    px = DEPTH_MM / camera.matrix[0, 0]
    steps = 0.05 * px * np.array([1, 1, DEPTH_MM / size, 1 / size, 1 / size, 1 / size])
    steps[3:5] *= 3
    turns = Pose(np.eye(3), pose.translation)

    def displaced(k: int, sign: int) -> Pose:
        return turns @ Pose.exp(sign * steps[k] * np.eye(6)[k]) @ turns.inverse() @ pose

    columns = [
        (seen(displaced(k, 1), look) - seen(displaced(k, -1), look)) / (2 * steps[k])
        for k in range(6)
    ]
    wider, narrower = (replace(look, psf_px=look.psf_px + d) for d in (0.02, -0.02))
    columns.append((seen(pose, wider) - seen(pose, narrower)) / 0.04)
    white = (levels.ravel() - levels.min()) / np.ptp(levels)
    x, y = (
        axis.ravel() for axis in np.meshgrid(*(np.linspace(-1, 1, n) for n in levels.shape[::-1]))
    )
    columns += [share * plane for share in (white, 1 - white) for plane in (np.ones_like(x), x, y)]
    used = _inside(camera, pose, region, inside).ravel()
    J = np.stack(columns, -1)[used]
    J = J / np.sqrt(look.shot * levels.ravel()[used] + look.read**2 + 1 / 12)[:, None]
    scale = 1 / np.linalg.norm(J, axis=0)
    covariance = np.linalg.inv((J * scale).T @ (J * scale)) * np.outer(scale, scale)

    def pixels(moved: Pose) -> Array:
        return camera.project(moved.apply(corners)).ravel()

    motion = np.stack(
        [(pixels(displaced(k, 1)) - pixels(displaced(k, -1))) / (2 * steps[k]) for k in range(6)],
        -1,
    )
    return np.asarray(motion @ covariance[:6, :6] @ motion.T)


def _inside(camera: Optics, pose: Pose, region: PixelRegion, inside: Array) -> Array:
    """Which pixels (height, width) of a region see the rectangle `inside` of the plane."""
    x, y = np.meshgrid(region.x + np.arange(region.width), region.y + np.arange(region.height))
    rays = camera.rays(np.stack([x, y], -1).astype(np.float64))
    R, t = pose.rotation, pose.translation
    back = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    plane = rays @ back[:, :2].T + back[:, 2]
    xy = plane[..., :2] / plane[..., 2:]
    return np.asarray(((xy > inside[0]) & (xy < inside[1])).all(-1))


def rms(errors: Sequence[Array]) -> float:
    """Root mean square of all numbers."""
    return float(np.sqrt(np.mean(np.square(np.array(errors)))))


def measured(
    seen: Shot, raster: Raster, pose: Pose, rng: np.random.Generator
) -> tuple[Refined, list[PlanarPose], Array]:
    """Refined corners, poses, and the true corners; from a rough start."""
    corners = np.column_stack([raster.corners, np.zeros(4)])
    true = seen.camera.project(pose.apply(corners))
    rough = true + rng.normal(0, ROUGH_PX, (4, 2))
    refined = refine(seen.pixels, raster, rough, lens_vector(seen.camera))
    if refined is None:
        raise AssertionError("a clean target was not measured")
    return (
        refined,
        planar_poses(seen.camera, corners, refined.corners_px, refined.covariance),
        true,
    )
