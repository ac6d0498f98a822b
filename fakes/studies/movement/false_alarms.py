"""A good cell, watched for hours: how often it is taken for one in which something moved.

Every visit of a pose draws the arm's stop anew; the field of the arm, the calibration and CAD have the
errors that they have. The sums that would alarm are compared with the chi-square distribution whose far
tail they are judged by: where their share beyond a common quantile is no larger than it says, the
alarms of a year are at most what the far quantiles say.
"""

from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.cameras import FIXED, MOVABLE
from fakes.studies.movement.visits import PERIOD_S, PICTURES, Visits
from fakes.studies.sessions import Session, known_arm
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import BORED_CENTER_MM, Simulation
from vgrd.calibration.joint import calibrate_joint, solution_of
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.geometry.chi2 import chi2_probability
from vgrd.judging.thresholds import CONTRADICTS, SLIPPED
from vgrd.model import Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(Plan.JOINT, looks=8, spins=10, touches=10, tilted=4)
_ARM = ArmErrors(sigma_mm=0.03, field_mm=0.15)
_POSES = 12
_VISITS = 150  # of one trial: 900 pictures, seven and a half minutes
_STABILITIES = {"fixed": FIXED, "movable": MOVABLE}
_SHARES = (1e-1, 1e-2, 1e-3)
_YEAR_S = 365.25 * 24 * 3600
_SUMS = 4  # two links, two windows


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Pictures refused, and the share of pictures and sums beyond common quantiles."""
    cell = Simulation(seed, vision=FINE, arm=_ARM, center_sigma_mm=BORED_CENTER_MM)
    recording = _SESSION.record(cell)
    solution = solution_of(calibrate_joint(recording, arm=known_arm(_ARM)))
    stability = _STABILITIES[parameters["stability"]]
    visits = Visits(cell, solution, recording.facts, stability, poses=_POSES)
    refused, sums = 0, []
    for report in islice(visits.go(_VISITS), _VISITS * PICTURES):
        refused += not report.fits
        for told in visits.series.sums():
            sums.append(chi2_probability(float(told @ told), len(told)) if len(told) else 0.0)
    out = {"pictures refused": float(refused), "pictures": float(_VISITS * PICTURES)}
    for share in _SHARES:
        out[f"sums beyond {share:g}"] = float(np.mean(np.array(sums) > 1 - share))
    return out


def _figures(trials: Trials) -> list[Figure]:
    out = []
    for case in _CASES:
        where = f"camera {case['stability']}"
        pictures = float(np.sum(trials.values("pictures", **case)))
        refused = float(np.sum(trials.values("pictures refused", **case)))
        hours = pictures * PERIOD_S / 3600
        out.append(Figure(f"{where}: watched", hours, "h"))
        out.append(Figure(f"{where}: pictures refused", refused, at_most=0))
        for share in _SHARES:
            found = trials.mean(f"sums beyond {share:g}", **case)
            out.append(
                Figure(f"{where}: sums beyond {share:g}, over it", found / share, "x", at_most=1.5)
            )
    pictures = _YEAR_S / PERIOD_S
    alarms = pictures * (1 - CONTRADICTS + _SUMS * (1 - SLIPPED))
    out.append(Figure("alarms of a good cell in a year, at most", alarms, at_most=2))
    return out


def _draw(trials: Trials) -> "Drawing":
    drawing, (axes,) = panels(
        f"A good cell, {len(trials.select())} of them", ("share of chance", "share of sums")
    )
    for color, case in zip(COLORS, _CASES, strict=False):
        shares = [max(trials.mean(f"sums beyond {s:g}", **case), 1e-6) for s in _SHARES]
        axes.loglog(_SHARES, shares, color=color, marker="o", label=f"camera {case['stability']}")
    axes.loglog(_SHARES, _SHARES, color=PAPER, ls=(0, (5, 3)), linewidth=1)
    legend(axes)
    return drawing


_CASES = tuple({"stability": stability} for stability in _STABILITIES)

STUDY = Study(
    name="false-alarms",
    title="A good cell that is watched",
    cases=_CASES,
    runs=100,
    full_runs=1000,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
