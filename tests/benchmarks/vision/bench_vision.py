"""Accuracy and self-knowledge of tag vision against the physical bound; peers are in bench_vision_peers.

Every row draws pictures with known truth (`fakes.camera.pictures`). VGRD_BENCH_SHARE scales the number of
pictures; 1 (300 poses per accuracy row, 2,000 for covariance and flags, 10,000 for flips) takes hours,
the default takes minutes.
"""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fakes.camera.patterns import Figure, charuco_pattern, grid_pattern, tag_pattern
from fakes.camera.pictures import Band, Look, Spot
from fakes.studies.prints import single_tags
from fakes.studies.runner import run_trials
from fakes.world.optics import Optics
from tests.benchmarks.harness import Row
from tests.benchmarks.vision.vision_truth import (
    NARROW,
    WIDE,
    corner_bound,
    measured,
    random_pose,
    rms,
    shot,
)
from vgrd.geometry import Pose
from vgrd.model import TagSpec
from vgrd.vision.alignment.quality import disturbance
from vgrd.vision.boards.fit import charuco_raster, tag_board_raster
from vgrd.vision.print.boards import Charuco
from vgrd.vision.print.raster import Raster, tag_raster
from vgrd.vision.tags.planar_pose import is_ambiguous

SHARE = float(os.environ.get("VGRD_BENCH_SHARE", "0.05"))
TILTS = (0, 20, 40, 60)
# Tilts of both tags, degrees; bars of the EC, mm: clean pictures, imperfect prints and sensors.
TARGET_BARS = {(3, 20): (0.002, 0.005), (20, 45): (0.002, 0.005), (45, 60): (0.003, 0.010)}
# As an office printer makes them, one or the other. NEES over its dimension, unless so many are flagged.
PRINTS = ("ink +0.01 mm", "ink -0.01 mm", "ink +0.01 mm in x", "stretched 0.1 % in x")
INKS_MM = (-0.01, 0.0, 0.01)  # of prints that any picture may show
PRINT_NEES, PRINT_FLAGGED = (0.5, 1.5), 0.95


def rows() -> Iterator[Row]:
    """All rows of accuracy and self-knowledge."""
    yield from _accuracy()
    yield from _target_errors()
    yield from _flips()
    yield from _prints()
    yield from _self_knowledge()


def _count(full: int, least: int) -> int:
    return max(round(full * SHARE), least)


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
        _, found, true = measured(seen, raster, pose, rng)
        errors.append(seen.camera.project(found[0].pose.apply(corners)) - true)
        if k < 3:
            bounds.append(np.trace(corner_bound(camera, figure, pose, corners, inside)) / 8)
    return rms(errors) / float(np.sqrt(np.mean(bounds))), rms(errors)


def _accuracy() -> Iterator[Row]:
    n = _count(300, 12)
    small = [(NARROW, 10.0, TILTS), (NARROW, 20.0, (20,)), (WIDE, 30.0, TILTS)]
    yield _worst("vision_corner_over_bound", _tags_over_bound(small, n), 1.2, n)
    large = [(NARROW, 32.0, (0, 20, 60))]
    yield _worst("vision_corner_over_bound_700px", _tags_over_bound(large, n), 1.6, n)
    yield _worst("vision_board_over_bound", _boards_over_bound(n), 1.3, n)


def _tags_over_bound(
    geometries: Sequence[tuple[Optics, float, Sequence[int]]], n: int
) -> list[tuple[float, str]]:
    """Ratio to the bound, and words, of tags of some sizes (mm) at some tilts (deg)."""
    found = []
    for camera, size_mm, tilts in geometries:
        tag = TagSpec("36h11", 7, size_mm)
        raster = tag_raster(tag.family, tag.id, tag.size_mm)
        for tilt in tilts:
            ratio, error = _ratio_to_bound(camera, tag_pattern(tag), raster, tilt, n, 100 + tilt)
            px = size_mm / 600 * camera.matrix[0, 0]
            found.append((ratio, f"{px:.0f} px at {tilt}: {error:.4f} px"))
    return found


def _boards_over_bound(n: int) -> list[tuple[float, str]]:
    board = Charuco(5, 5, 4.0, 3.2, "apriltag_36h11")
    tags = [TagSpec("36h11", i, 9.0) for i in range(4)]
    grid = {tag: np.array([i % 2, i // 2]) * 11.0 for i, tag in enumerate(tags)}
    found = []
    for name, figure, raster in (
        ("ChArUco 5x5", charuco_pattern(board), charuco_raster(board)),
        ("2x2 tags", grid_pattern(tags, 2, 2.0), tag_board_raster(grid, 9 / 8)),
    ):
        ratio, error = _ratio_to_bound(NARROW, figure, raster, 20, n, 7)
        found.append((ratio, f"{name}: {error:.4f} px"))
    return found


def _worst(name: str, found: Sequence[tuple[float, str]], bar: float, n: int) -> Row:
    """The row of the worst of several geometries; the root mean square of all in the note."""
    value, note = max(found)
    mean = float(np.sqrt(np.mean([ratio**2 for ratio, _ in found])))
    return Row.at_most(
        name, value, "x", bar, f"worst of {len(found)}: {note}; all {mean:.2f}; {n} each"
    )


def _target_errors() -> Iterator[Row]:
    """EC from vision alone: tags 110 mm apart, target 40 mm from tag B, errors across the view."""
    for (low, high), (clean_mm, other_mm) in TARGET_BARS.items():
        yield from _target_errors_within(low, high, clean_mm, other_mm)


def _target_errors_within(low: float, high: float, clean_mm: float, other_mm: float) -> list[Row]:
    """Tags tilted by low to high degrees; the bars of clean pictures and of the others, mm."""
    looks = {
        "clean": Look(),
        "ink +0.01": Look(ink_mm=0.01),
        "ink -0.01": Look(ink_mm=-0.01),
        "gamma 0.45": Look(gamma=0.45),
        "gamma 0.7": Look(gamma=0.7),
        "clipped": Look(exposure=1.35),
    }
    n = _count(300, 8)
    means = {name: _target_error(look, n, (low, high)) for name, look in looks.items()}
    clean = means.pop("clean")
    name = max(means, key=lambda key: means[key])
    note = ", ".join(f"{key} {value:.4f}" for key, value in means.items())
    tilts = f"tilts {low}-{high}"
    return [
        Row.at_most(f"vision_ec_xy_clean_{high}", clean, "mm", clean_mm, f"{tilts}, mean of {n}"),
        Row.at_most(
            f"vision_ec_xy_print_and_sensor_{high}",
            means[name],
            "mm",
            other_mm,
            f"{tilts}, {n} each: {note}",
        ),
    ]


def _target_error(look: Look, n: int, tilts: tuple[float, float]) -> float:
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(n):
        true, found = [], []
        for side, tag in ((-1, TagSpec("36h11", 7, 10.0)), (1, TagSpec("36h11", 11, 10.0))):
            lean = random_pose(NARROW, rng, rng.uniform(*tilts), spread=0.0)
            place = np.array([side * 55.0, rng.uniform(-35, 35), 600 + rng.uniform(-10, 10)])
            pose = Pose(lean.rotation, place)
            seen = shot(NARROW, tag_pattern(tag), pose, rng, look)
            raster = tag_raster(tag.family, tag.id, tag.size_mm)
            true.append(pose)
            found.append(measured(seen, raster, pose, rng)[1][0].pose)
        angle = rng.uniform(0, 2 * np.pi)
        target = np.array([40 * np.cos(angle), 40 * np.sin(angle), 0.0])
        off = found[0].inverse().apply(found[1].apply(target)) - true[0].inverse().apply(
            true[1].apply(target)
        )
        errors.append(np.linalg.norm((true[0].rotation @ off)[:2]))
    return float(np.mean(errors))


def _flips() -> Iterator[Row]:
    """How often the wrong one of two poses is chosen without saying that both fit."""
    n = _count(10_000, 60)
    for name, inks_mm in (("vision_flips", (0.0,)), ("vision_flips_ink", INKS_MM)):
        flips, unsure = _flips_among(n, inks_mm)
        note = f"{n} pictures, {unsure} said to be ambiguous"
        yield Row.at_most(name, flips, "", 0, note)


def _flips_among(n: int, inks_mm: Sequence[float]) -> tuple[int, int]:
    """Wrong ones, and pictures that are said to fit both, of tags printed with any of these inks."""
    rng = np.random.default_rng(17)
    tag = TagSpec("36h11", 7, 10.0)
    raster, flips, unsure = tag_raster(tag.family, tag.id, tag.size_mm), 0, 0
    for k in range(n):
        pose = random_pose(NARROW, rng, rng.uniform(0, 2 if k % 2 else 60))
        look = Look(ink_mm=inks_mm[k // 2 % len(inks_mm)])
        seen = shot(NARROW, tag_pattern(tag), pose, rng, look)
        _, poses, _ = measured(seen, raster, pose, rng)
        unsure += is_ambiguous(poses)
        if len(poses) > 1 and not is_ambiguous(poses):
            flips += poses[1].pose.distance(pose)[1] < poses[0].pose.distance(pose)[1]
    return flips, unsure


def _prints() -> Iterator[Row]:
    """Covariance of imperfect prints, drawn by a renderer that shares nothing with the fit (study `single-tags`)."""
    n = _count(200, 10)
    for print_name in PRINTS:
        ratios, flagged = zip(*(_nees_of(print_name, tilt, n) for tilt in TILTS), strict=True)
        low, high = PRINT_NEES
        off = [
            max(ratio / high, low / ratio)
            for ratio, share in zip(ratios, flagged, strict=True)
            if share < PRINT_FLAGGED
        ]
        note = ", ".join(
            f"{ratio:.2f} at {tilt}" for ratio, tilt in zip(ratios, TILTS, strict=True)
        )
        name = "vision_nees_" + re.sub(r"[^a-z0-9]+", "_", print_name.replace("-", "minus "))
        note = f"over {low:g}-{high:g}; NEES over 6 {note}; {n} pictures each, flagged {100 * max(flagged):.0f} %"
        yield Row.at_most(name, max(off, default=0.0), "x", 1.0, note)


def _nees_of(print_name: str, tilt_deg: int, n: int) -> tuple[float, float]:
    """Mean NEES over its dimension, and the share that was flagged or gave no pose."""
    case = {"fault": print_name, "tilt_deg": tilt_deg}
    trials = run_trials(replace(single_tags.STUDY, cases=(case,)), n, seed=29)
    return trials.finite_mean("nees") / 6, trials.mean("flagged")


def _self_knowledge() -> Iterator[Row]:
    """Whether covariance and flags tell the truth."""
    rng = np.random.default_rng(23)
    tag = TagSpec("36h11", 7, 10.0)
    raster = tag_raster(tag.family, tag.id, tag.size_mm)
    squares, flagged, n = [], 0, _count(2000, 60)
    for _ in range(n):
        pose = random_pose(NARROW, rng, rng.uniform(0, 60))
        refined, poses, _ = measured(shot(NARROW, tag_pattern(tag), pose, rng), raster, pose, rng)
        xi = (poses[0].pose @ pose.inverse()).log()
        squares.append(float(xi @ np.linalg.solve(poses[0].covariance, xi)))
        flagged += disturbance(refined) is not None
    off = abs(float(np.mean(squares)) / 6 - 1)
    error = np.sqrt(2 / (6 * n))  # of the mean of n chi-squares of 6, over 6
    note = f"mean NEES {np.mean(squares):.2f} of 6, {n} pictures, standard error {error:.3f}"
    yield Row.at_most("vision_nees_off_by", off, "", round(0.05 + 2 * error, 3), note)
    yield Row.at_most("vision_clean_flagged", flagged / n, "", 0.01, f"{n} clean pictures")
    m = _count(1000, 20)
    for name, look in (("shadow", _shadow), ("glare", _glare), ("motion", _motion)):
        caught = 0
        for _ in range(m):
            pose = random_pose(NARROW, rng, rng.uniform(0, 45))
            disturbed = replace(look(rng), ink_mm=float(rng.choice(INKS_MM)))
            seen = shot(NARROW, tag_pattern(tag), pose, rng, disturbed)
            caught += disturbance(measured(seen, raster, pose, rng)[0]) is not None
        note = f"{m} pictures, ink of 0.01 mm more, less or as stated"
        yield Row.at_least(f"vision_{name}_flagged", caught / m, "", 0.99, note)


def _shadow(rng: np.random.Generator) -> Look:
    return Look(shadow=Band(rng.uniform(0, 6.28), rng.uniform(-50, 50), softness_px=6.0))


def _glare(rng: np.random.Generator) -> Look:
    x, y = rng.uniform(-60, 60, 2)
    return Look(glare=Spot(90.0, x, y, 45.0))


def _motion(rng: np.random.Generator) -> Look:
    return Look(motion_px=rng.uniform(3, 6), motion_rad=rng.uniform(0, np.pi))
