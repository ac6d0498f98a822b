"""Accuracy, self-knowledge and speed of tag vision, against the physical bound and against peers.

Every row draws pictures with known truth (`fakes.pictures`). VGRD_BENCH_SHARE scales the number of
pictures; 1 (300 poses per accuracy row, 2,000 for covariance and flags, 10,000 for flips) takes hours,
the default takes minutes.
"""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import pupil_apriltags
import pyapriltags

from fakes.optics import Optics
from fakes.patterns import Figure, charuco_pattern, grid_pattern, tag_pattern
from fakes.pictures import Band, Look, Placed, Spot, draw
from tests.benchmarks.harness import Row, ratio_of
from tests.benchmarks.vision_truth import NARROW, WIDE, Shot, corner_bound, random_pose, rms, shot
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.vision.board_fit import charuco_raster, tag_board_raster
from vgrd.vision.boards import Charuco
from vgrd.vision.codes import dictionary_of, square_corners
from vgrd.vision.planar import PlanarPose, is_ambiguous, planar_poses
from vgrd.vision.quality import disturbance
from vgrd.vision.raster import Raster, tag_raster
from vgrd.vision.refining import Refined, refine
from vgrd.vision.tags import TagDetector
from vgrd.vision.warp import lens_vector

SHARE = float(os.environ.get("VGRD_BENCH_SHARE", "0.05"))
TILTS = (0, 20, 40, 60)
ROUGH_PX = 0.7  # error of the corners that a fit starts from


def rows() -> list[Row]:
    """All rows of tag vision."""
    return [
        *_accuracy(),
        *_peers(),
        *_target_errors(),
        *_flips(),
        *_self_knowledge(),
        *_latency(),
    ]


def _count(full: int, least: int) -> int:
    return max(round(full * SHARE), least)


def _measured(
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


def _ratio_to_bound(
    camera: Optics, figure: Figure, raster: Raster, tilt: float, poses: int, seed: int
) -> tuple[float, float]:
    """RMSE of the corners of the estimated pose over their bound, and the RMSE, px."""
    rng = np.random.default_rng(seed)
    corners = np.column_stack([raster.corners, np.zeros(4)])
    inside = np.array([[raster.x[0], raster.y[0]], [raster.x[-1], raster.y[-1]]])
    inside += 0.15 * raster.smallest_cell * np.array([[1], [-1]])
    errors, bounds = [], []
    for k in range(poses):
        pose = random_pose(camera, rng, tilt)
        seen = shot(camera, figure, pose, rng)
        _, found, true = _measured(seen, raster, pose, rng)
        errors.append(seen.camera.project(found[0].pose.apply(corners)) - true)
        if k < 3:
            bounds.append(np.trace(corner_bound(camera, figure, pose, corners, inside)) / 8)
    return rms(errors) / float(np.sqrt(np.mean(bounds))), rms(errors)


def _accuracy() -> list[Row]:
    n = _count(300, 12)
    small, large = [], []
    for camera, size_mm, tilts, group in (
        (NARROW, 10.0, TILTS, small),
        (NARROW, 20.0, (20,), small),
        (WIDE, 30.0, TILTS, small),
        (NARROW, 32.0, (0, 20, 60), large),
    ):
        tag = TagSpec("36h11", 7, size_mm)
        raster = tag_raster(tag.family, tag.id, tag.size_mm)
        for tilt in tilts:
            ratio, error = _ratio_to_bound(camera, tag_pattern(tag), raster, tilt, n, 100 + tilt)
            px = size_mm / 600 * camera.matrix[0, 0]
            group.append((ratio, f"{px:.0f} px at {tilt}: {error:.4f} px"))
    board = Charuco(5, 5, 4.0, 3.2, "apriltag_36h11")
    tags = [TagSpec("36h11", i, 9.0) for i in range(4)]
    grid = {tag: np.array([i % 2, i // 2]) * 11.0 for i, tag in enumerate(tags)}
    boards = []
    for name, figure, raster in (
        ("ChArUco 5x5", charuco_pattern(board), charuco_raster(board)),
        ("2x2 tags", grid_pattern(tags, 2, 2.0), tag_board_raster(grid, 9 / 8)),
    ):
        ratio, error = _ratio_to_bound(NARROW, figure, raster, 20, n, 7)
        boards.append((ratio, f"{name}: {error:.4f} px"))
    return [
        _worst("vision_corner_over_bound", small, 1.2, n),
        _worst("vision_corner_over_bound_700px", large, 1.6, n),
        _worst("vision_board_over_bound", boards, 1.3, n),
    ]


def _worst(name: str, found: Sequence[tuple[float, str]], bar: float, n: int) -> Row:
    """The row of the worst of several geometries; the root mean square of all in the note."""
    value, note = max(found)
    mean = float(np.sqrt(np.mean([ratio**2 for ratio, _ in found])))
    return Row.at_most(
        name, value, "x", bar, f"worst of {len(found)}: {note}; all {mean:.2f}; {n} each"
    )


def _peers() -> list[Row]:
    rng = np.random.default_rng(5)
    tag = TagSpec("36h11", 7, 10.0)
    raster = tag_raster(tag.family, tag.id, tag.size_mm)
    errors: dict[str, list[Array]] = {}
    finders = _peer_finders()
    for _ in range(_count(300, 10)):
        pose = random_pose(NARROW, rng, 20)
        seen = shot(NARROW, tag_pattern(tag), pose, rng)
        _, poses, true = _measured(seen, raster, pose, rng)
        ours = seen.camera.project(poses[0].pose.apply(square_corners(tag.size_mm)))
        errors.setdefault("ours", []).append(ours - true)
        for name, find in finders.items():
            corners = find(seen.pixels)
            if corners is not None:
                errors.setdefault(name, []).append(_in_order(corners, true) - true)
    best = rms(errors["ours"])
    opencv = min(rms(errors[name]) for name in finders if name.startswith("OpenCV"))
    note = ", ".join(f"{name} {rms(found):.4f}" for name, found in errors.items()) + " px"
    return [
        Row.at_least("vision_vs_pyapriltags", rms(errors["pyapriltags"]) / best, "x", 4, note),
        Row.at_least("vision_vs_pupil", rms(errors["pupil-apriltags"]) / best, "x", 15),
        Row.at_least("vision_vs_opencv", opencv / best, "x", 100, "its best refinement, as it is"),
    ]


def _peer_finders() -> dict[str, Callable[[np.ndarray], Array | None]]:
    """Corner finders of other libraries; those that count pixels from their rim are shifted by a half."""

    def published(detector: object) -> Callable[[np.ndarray], Array | None]:
        def find(pixels: np.ndarray) -> Array | None:
            found = detector.detect(pixels)
            return np.array(found[0].corners) - 0.5 if found else None

        return find

    def opencv(method: int) -> Callable[[np.ndarray], Array | None]:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = method
        detector = cv2.aruco.ArucoDetector(dictionary_of("36h11"), parameters)

        def find(pixels: np.ndarray) -> Array | None:
            corners, ids, _ = detector.detectMarkers(pixels)
            return None if ids is None else np.array(corners[0], float).reshape(4, 2)

        return find

    return {
        "pyapriltags": published(pyapriltags.Detector(families="tag36h11", quad_decimate=1.0)),
        "pupil-apriltags": published(
            pupil_apriltags.Detector(families="tag36h11", quad_decimate=1.0)
        ),
        "OpenCV NONE": opencv(cv2.aruco.CORNER_REFINE_NONE),
        "OpenCV SUBPIX": opencv(cv2.aruco.CORNER_REFINE_SUBPIX),
        "OpenCV CONTOUR": opencv(cv2.aruco.CORNER_REFINE_CONTOUR),
        "OpenCV APRILTAG": opencv(cv2.aruco.CORNER_REFINE_APRILTAG),
    }


def _in_order(corners: Array, true: Array) -> Array:
    """The same four corners, starting and turning as the true ones."""
    turned = [np.roll(way, k, 0) for way in (corners, corners[::-1]) for k in range(4)]
    return min(turned, key=lambda c: float(np.abs(c - true).sum()))


def _target_errors() -> list[Row]:
    """EC from vision alone: tags 110 mm apart, target 40 mm from tag B, errors across the view."""
    looks = {
        "clean": Look(),
        "ink +0.01": Look(ink_mm=0.01),
        "ink -0.01": Look(ink_mm=-0.01),
        "gamma 0.45": Look(gamma=0.45),
        "gamma 0.7": Look(gamma=0.7),
        "clipped": Look(exposure=1.35),
    }
    n = _count(300, 8)
    means = {name: _target_error(look, n) for name, look in looks.items()}
    clean = means.pop("clean")
    name = max(means, key=lambda key: means[key])
    note = ", ".join(f"{key} {value:.4f}" for key, value in means.items())
    return [
        Row.at_most("vision_ec_xy_clean", clean, "mm", 0.002, f"mean of {n}"),
        Row.at_most("vision_ec_xy_print_and_sensor", means[name], "mm", 0.005, note),
    ]


def _target_error(look: Look, n: int) -> float:
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(n):
        true, found = [], []
        for side, tag in ((-1, TagSpec("36h11", 7, 10.0)), (1, TagSpec("36h11", 11, 10.0))):
            lean = random_pose(NARROW, rng, rng.uniform(3, 20), spread=0.0)
            place = np.array([side * 55.0, rng.uniform(-35, 35), 600 + rng.uniform(-10, 10)])
            pose = Pose(lean.rotation, place)
            seen = shot(NARROW, tag_pattern(tag), pose, rng, look)
            raster = tag_raster(tag.family, tag.id, tag.size_mm)
            true.append(pose)
            found.append(_measured(seen, raster, pose, rng)[1][0].pose)
        angle = rng.uniform(0, 2 * np.pi)
        target = np.array([40 * np.cos(angle), 40 * np.sin(angle), 0.0])
        off = found[0].inverse().apply(found[1].apply(target)) - true[0].inverse().apply(
            true[1].apply(target)
        )
        errors.append(np.linalg.norm((true[0].rotation @ off)[:2]))
    return float(np.mean(errors))


def _flips() -> list[Row]:
    """How often the wrong one of two poses is chosen without saying that both fit."""
    rng = np.random.default_rng(17)
    tag = TagSpec("36h11", 7, 10.0)
    raster, n, flips, unsure = (
        tag_raster(tag.family, tag.id, tag.size_mm),
        _count(10_000, 60),
        0,
        0,
    )
    for k in range(n):
        pose = random_pose(NARROW, rng, rng.uniform(0, 2 if k % 2 else 60))
        _, poses, _ = _measured(shot(NARROW, tag_pattern(tag), pose, rng), raster, pose, rng)
        unsure += is_ambiguous(poses)
        if len(poses) > 1 and not is_ambiguous(poses):
            flips += poses[1].pose.distance(pose)[1] < poses[0].pose.distance(pose)[1]
    return [
        Row.at_most("vision_flips", flips, "", 0, f"{n} pictures, {unsure} said to be ambiguous")
    ]


def _self_knowledge() -> list[Row]:
    """Whether covariance and flags tell the truth."""
    rng = np.random.default_rng(23)
    tag = TagSpec("36h11", 7, 10.0)
    raster = tag_raster(tag.family, tag.id, tag.size_mm)
    squares, flagged, n = [], 0, _count(2000, 60)
    for _ in range(n):
        pose = random_pose(NARROW, rng, rng.uniform(0, 60))
        refined, poses, _ = _measured(shot(NARROW, tag_pattern(tag), pose, rng), raster, pose, rng)
        xi = (poses[0].pose @ pose.inverse()).log()
        squares.append(float(xi @ np.linalg.solve(poses[0].covariance, xi)))
        flagged += disturbance(refined) is not None
    off = abs(float(np.mean(squares)) / 6 - 1)
    note = f"mean NEES {np.mean(squares):.2f} of 6, {n} pictures"
    found = [
        Row.at_most("vision_nees_off_by", off, "", 0.05, note),
        Row.at_most("vision_clean_flagged", flagged / n, "", 0.01, f"{n} clean pictures"),
    ]
    m = _count(1000, 20)
    for name, look in (("shadow", _shadow), ("glare", _glare), ("motion", _motion)):
        caught = 0
        for _ in range(m):
            pose = random_pose(NARROW, rng, rng.uniform(0, 45))
            seen = shot(NARROW, tag_pattern(tag), pose, rng, look(rng))
            caught += disturbance(_measured(seen, raster, pose, rng)[0]) is not None
        found.append(Row.at_least(f"vision_{name}_flagged", caught / m, "", 0.99, f"{m} pictures"))
    return found


def _shadow(rng: np.random.Generator) -> Look:
    return Look(shadow=Band(rng.uniform(0, 6.28), rng.uniform(-50, 50), softness_px=6.0))


def _glare(rng: np.random.Generator) -> Look:
    x, y = rng.uniform(-60, 60, 2)
    return Look(glare=Spot(90.0, x, y, 45.0))


def _motion(rng: np.random.Generator) -> Look:
    return Look(motion_px=rng.uniform(3, 6), motion_rad=rng.uniform(0, np.pi))


def _latency() -> list[Row]:
    """One picture of 12 MP with two tags: ours, cold and tracking, against pyapriltags on all of it."""
    rng = np.random.default_rng(3)
    tags = [TagSpec("36h11", 7, 15.0), TagSpec("36h11", 11, 10.0)]
    places = [Pose(random_pose(NARROW, rng, 20, 0.0).rotation, (x, 5.0, 600.0)) for x in (-40, 35)]
    scene = draw(NARROW, [Placed(tag_pattern(t), p) for t, p in zip(tags, places, strict=True)])
    width, height = NARROW.size_px
    clutter = cv2.resize(rng.uniform(70, 120, (48, 64)).astype(np.float32), (width, height))
    for _ in range(250):
        corner, size = rng.integers(0, [width, height]), int(rng.integers(20, 200))
        quad = (corner + rng.integers(-size, size, (4, 2))).astype(np.int32)
        cv2.fillConvexPoly(clutter, quad, float(rng.uniform(30, 180)))
    picture = np.clip(clutter + rng.normal(0, 1.5, clutter.shape), 0, 255).astype(np.uint8)
    picture[scene.region.slices] = scene.pixels
    camera = CameraModel(NARROW.matrix, NARROW.distortion, NARROW.size_px)
    bare = pyapriltags.Detector(families="tag36h11", nthreads=2, quad_decimate=1.0)
    with TagDetector(camera.matrix, camera.distortion, tags, camera.size_px) as detector:
        last = detector.detect(picture)

        def timed(work: Callable[[], object]) -> Callable[[], float]:
            def once() -> float:
                start = time.perf_counter()
                work()
                return time.perf_counter() - start

            return once

        if sorted(last) != [7, 11]:
            raise AssertionError("the benchmark's tags were not found")
        cold = timed(lambda: detector.detect(picture))
        tracking = timed(lambda: detector.detect(picture, last))
        peer = timed(lambda: bare.detect(picture))
        found = []
        for name, ours, bar in (("cold", cold, 30.0), ("tracking", tracking, 100.0)):
            ratio, peer_s, ours_s = ratio_of(peer, ours, 5)
            note = f"{1e3 * ours_s:.1f} ms against {1e3 * peer_s:.0f} ms"
            found.append(Row.at_least(f"vision_{name}_vs_pyapriltags", ratio, "x", bar, note))
    with ProcessPoolExecutor(1, get_context("spawn")) as fresh:
        used = fresh.submit(_peak_mib, camera, tags, picture).result()
    found.append(Row.at_most("vision_memory", used, "MiB", 400.0, "peak of a process of its own"))
    return found


def _peak_mib(camera: CameraModel, tags: list[TagSpec], picture: np.ndarray) -> float:
    """Peak memory of this process after it measured a picture cold and tracking."""
    with TagDetector(camera.matrix, camera.distortion, tags, camera.size_px) as detector:
        detector.detect(picture, detector.detect(picture))
    status = Path("/proc/self/status").read_text()  # getrusage would count the parent's
    (peak,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(peak) / 1024
