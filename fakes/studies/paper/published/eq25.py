"""Eq. 20-25 as printed: the matrix of Eq. 25 is singular for every turntable, and noise decides along the axis.

Ten pictures of the turning tag, evenly spread over the turn; experiment B's coarse noise, a part of it, and none.
The error of a centre is split into what is along the axis, where any point serves, and its distance from the axis.
The answer of Eq. 19 with that centre, touches and hand-eye exact, shows what a caller would see of it.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.paper.baselines import tag_b_in
from fakes.studies.paper.published.equations import equation_25
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.noise import COARSE, Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.stepwise import motion_about, moved_flange
from vgrd.calibration.turntable import find_rotation_center
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose
from vgrd.model import TagObservation

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

PRINTED, OURS = "Eq. 25", "ours"
ALONG, FROM, ANSWER = "along the axis", "from the axis", "answer"
_PARTS = (ALONG, FROM, ANSWER)
EXACT = "exact"
_NOISE: Mapping[str, float] = MappingProxyType(  # parts of experiment B's coarse one
    {EXACT: 0.0, "fine": 0.05, "quarter": 0.25, "coarse": 1.0}
)
_PICTURES = 10  # the paper's table 4
_ALL_AROUND_DEG = 324.0  # ten pictures, evenly spread over the whole turn
_TURNS_DEG = (30.0, 60.0, 90.0, 180.0, _ALL_AROUND_DEG)  # from hardly turned on
_NOTHING_MM = 1e-6  # rounding of poses within a metre
_REQUESTS = 3  # turns of the table, as in table 3


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Errors of both centres, mm, NaN where Eq. 25 has none, and the condition of its matrix."""
    cell = Simulation(seed, vision=_times(COARSE, _NOISE[parameters["noise"]]))
    start = cell.rng.uniform(-np.pi, np.pi)
    angles = start + np.linspace(0, np.radians(parameters["turn_deg"]), _PICTURES)
    tags = [_tag_b(cell, float(angle)) for angle in angles]
    poses = [tag.camera_from_tag for tag in tags]
    covariances = [tag.covariance for tag in tags] if parameters["noise"] != EXACT else None
    row, centers = _printed(poses)
    centers[OURS] = find_rotation_center(poses, covariances).center_in_tag
    ref = _tag_b(cell, 0.0).camera_from_tag
    requests = [float(cell.rng.uniform(-np.pi, np.pi)) for _ in range(_REQUESTS)]
    seen = [(angle, _tag_b(cell, angle).camera_from_tag) for angle in requests]
    for name, center in centers.items():
        row |= {f"{name}, {part}": value for part, value in _errors(cell, center).items()}
        misses = [_miss_mm(cell, ref, now, angle, center) for angle, now in seen]
        row[f"{name}, {ANSWER}"] = float(np.mean(misses))
    return row


def _printed(poses: Sequence[Pose]) -> tuple[dict[str, float], dict[str, Array]]:
    """Row with the condition, and the centre; NaN and none where the matrix is singular to the last digit."""
    try:
        center = equation_25(poses)
    except NotObservable:
        nothing = {f"{PRINTED}, {part}": float("nan") for part in _PARTS}
        return {"singular": 1.0, "condition": float("nan"), **nothing}, {}
    row = {"singular": 0.0, "condition": center.condition}
    return row, {PRINTED: center.center_in_tag}


def _times(vision: Vision, factor: float) -> Vision:
    return Vision(
        vision.lateral_mm * factor,
        vision.depth_mm * factor,
        vision.tilt_deg * factor,
        vision.roll_deg * factor,
    )


def _tag_b(cell: Simulation, angle_rad: float) -> TagObservation:
    return tag_b_in(cell.observe(cell.standing, angle_rad))


def _errors(cell: Simulation, center_in_tag: Array) -> dict[str, float]:
    """How far it is along the axis from CAD's centre, and from the axis, mm."""
    in_object = cell.object_from_tag_b @ center_in_tag
    return {ALONG: float(abs(in_object[2])), FROM: float(np.linalg.norm(in_object[:2]))}


def _miss_mm(
    cell: Simulation, ref: Pose, now: Pose, angle_rad: float, center_in_tag: Array
) -> float:
    """Miss in xy of Eq. 19's answer for P1."""
    flange = cell.flange("P1", 0.0, WORK_ROTATION)
    pivot = cell.center_in_base - WORK_ROTATION @ cell.tcp_in_wrist
    Q = motion_about(now, ref, center_in_tag)
    answer = moved_flange(cell.base_from_camera.rotation, Q, flange, pivot)
    return float(np.linalg.norm((answer - cell.flange("P1", angle_rad, WORK_ROTATION))[:2]))


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for noise in _NOISE:
        case = {"noise": noise, "turn_deg": _ALL_AROUND_DEG}
        condition = _percentile(trials, "condition", 50, **case)
        figures.append(Figure(f"{noise}: condition of the matrix of Eq. 25", condition))
        for name, part in product((PRINTED, OURS), (FROM, ANSWER)):
            value = _percentile(trials, f"{name}, {part}", 50, **case)
            bar = _NOTHING_MM if (name, noise) == (OURS, EXACT) else None
            figures.append(Figure(f"{noise}: {name}, {part}", value, "mm", at_most=bar))
        value = _percentile(trials, f"{PRINTED}, {ALONG}", 95, **case)
        figures.append(Figure(f"{noise}: {PRINTED}, {ALONG}, 95 % below", value, "mm"))
    singular = 100 * trials.mean("singular", noise=EXACT)
    figures.append(Figure("exact: matrix singular to the last digit", singular, "%"))
    for turn in _TURNS_DEG:
        printed, ours = (
            _percentile(trials, f"{name}, {FROM}", 50, noise="coarse", turn_deg=turn)
            for name in (PRINTED, OURS)
        )
        figures.append(
            Figure(
                f"coarse: ours / Eq. 25, {FROM}, {turn:g} degrees", ours / printed, "", None, 1.0
            )
        )
    return figures


def _percentile(trials: Trials, column: str, percent: float, **case: object) -> float:
    """Of all centres that there are; a mean would be that of the worst."""
    values = trials.values(column, **case)
    known = values[np.isfinite(values)]
    return float(np.percentile(known, percent)) if known.size else float("nan")


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(noise=EXACT, turn_deg=_ALL_AROUND_DEG))
    turn = "the tag turned by, degrees"
    drawing, (conditions, errors) = panels(
        f"Rotation centre by Eq. 25 as printed, median of {runs} (Eq. 20-25)",
        (turn, "condition of the inverted matrix"),
        (turn, "error of the centre, mm"),
    )

    def medians(column: str, noise: str, percent: float = 50) -> list[float]:
        return [_percentile(trials, column, percent, noise=noise, turn_deg=t) for t in _TURNS_DEG]

    for color, noise in zip(COLORS, _NOISE, strict=False):
        label = f"{noise} vision"
        conditions.plot(_TURNS_DEG, medians("condition", noise), "o-", color=color, label=label)
        for name, style in ((PRINTED, "o-"), (OURS, "s:")):
            if (name, noise) == (OURS, EXACT):
                continue  # rounding, far below the picture
            note = f"{name}, {FROM}" if noise == "coarse" else None
            error = medians(f"{name}, {FROM}", noise)
            errors.plot(_TURNS_DEG, error, style, color=color, label=note)
    along = medians(f"{PRINTED}, {ALONG}", "coarse", 95)
    note = f"{PRINTED}, {ALONG}, coarse, 95 %"
    errors.plot(_TURNS_DEG, along, "o--", color=PAPER, label=note)
    for axes in (conditions, errors):
        axes.set_yscale("log")
        axes.set_xticks(_TURNS_DEG)
    legend(conditions, "center right")
    legend(errors, "center right")
    return drawing


STUDY = Study(
    name="eq25",
    title="Eq. 20-25 as printed: the rotation centre by a matrix that has no inverse",
    cases=tuple({"noise": n, "turn_deg": turn} for n in _NOISE for turn in _TURNS_DEG),
    runs=200,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
