"""Time offset: pictures of an arm that is jogged, their stamps late by 0 to 100 ms, found from the pictures themselves.

Each trial draws a skew, a jog of a minute or two, and what disturbs the stamps in its case. The offset is told with its
sigma, or as unknown.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.paper.arms import SIX_AXES, cell_with
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.jogged_pictures import Jog, jogged_pictures
from vgrd.calibration.timing import find_time_offset
from vgrd.charts import COLORS, panels
from vgrd.geometry import Array, Pose
from vgrd.geometry.track import PoseTrack

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_WIDEST_S = 0.1
_WITHIN_S = 3e-3
_JOGS: Mapping[str, Jog] = MappingProxyType(
    {
        "a jog of 20 moves": Jog(moves=20),
        "6 moves": Jog(moves=6),
        "rolling shutter, 40 ms": Jog(moves=20, roll_s=0.04),
        "pictures' stamps jitter, 5 ms": Jog(moves=20, jitter_s=0.005),
        "pictures' stamps jitter, 20 ms": Jog(moves=20, jitter_s=0.02),
        "poses' stamps jitter, 2 ms": Jog(moves=20, reading_jitter_s=0.002),
        "5 poses a second": Jog(moves=20, reading_hz=5.0),
        "hardly any motion": Jog(moves=20, span=0.05),
    }
)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Error, s, in seconds and in its sigmas; NaN where it is unknown."""
    cell = cell_with(SIX_AXES, seed)
    skew_s = float(cell.rng.uniform(0, _WIDEST_S))
    made = jogged_pictures(cell, replace(_JOGS[parameters["jog"]], skew_s=skew_s))
    off = cell.rng.normal(size=6) * ([0.5] * 3 + [1e-3] * 3)  # as a calibration errs at worst
    offset = find_time_offset(
        cell.facts(),
        PoseTrack.of(made.stamps_s, made.poses),
        made.moving,
        made.rests,
        Pose.exp(off) @ cell.base_from_camera,
        cell.wrist_from_tag_a,
    )
    if offset.unknown:
        return {"skew_s": skew_s, "unknown": 1.0, "error_s": np.nan, "sigmas": np.nan}
    error_s = offset.offset_s - skew_s
    return {
        "skew_s": skew_s,
        "unknown": 0.0,
        "error_s": error_s,
        "sigmas": error_s / offset.sigma_s,
    }


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name in _JOGS:
        errors_ms = 1e3 * _known(trials, "error_s", name)
        if errors_ms.size:
            rms, worst = np.sqrt(np.mean(errors_ms**2)), np.abs(errors_ms).max()
            figures.append(Figure(f"{name}: rms error", float(rms), "ms"))
            figures.append(Figure(f"{name}: largest", float(worst), "ms", at_most=1e3 * _WITHIN_S))
        unknown = 100 * trials.mean("unknown", jog=name)
        figures.append(Figure(f"{name}: unknown", unknown, "%"))
    sigmas = np.concatenate([_known(trials, "sigmas", name) for name in _JOGS])
    within = float(np.mean(np.abs(sigmas) < 2)) if sigmas.size else float("nan")
    return [*figures, Figure("within 2 sigma", 100 * within, "%", at_least=93)]


def _known(trials: Trials, column: str, jog: str) -> Array:
    values = trials.values(column, jog=jog)
    return np.asarray(values[np.isfinite(values)])


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(jog=next(iter(_JOGS))))
    drawing, (axes,) = panels(
        f"Time between poses and pictures, {runs} jogs each", ("error, ms", "")
    )
    for place, name in enumerate(_JOGS):
        errors_ms = 1e3 * _known(trials, "error_s", name)
        axes.plot(errors_ms, np.full(errors_ms.size, place), "|", color=COLORS[0], ms=9)
    axes.axvspan(-1e3 * _WITHIN_S, 1e3 * _WITHIN_S, color=COLORS[1], alpha=0.15)
    axes.set_yticks(range(len(_JOGS)), list(_JOGS))
    axes.invert_yaxis()
    return drawing


STUDY = Study(
    name="time-offset",
    title="Time between poses and pictures from a jog, skew 0 to 100 ms",
    cases=tuple({"jog": name} for name in _JOGS),
    runs=20,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
