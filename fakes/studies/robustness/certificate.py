"""Wrong optima: plain Gauss-Newton from the identity against the default, many small problems."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence, default_rng
from scipy.spatial.transform import Rotation

from fakes.studies.paper.paper_data import draw
from fakes.studies.study import Figure, Parameters, Study, Trials
from vgrd.calibration.universal import (
    Equations,
    UniversalProblem,
    calibrate_universal,
    retract,
)
from vgrd.charts import COLORS, legend, panels
from vgrd.errors import CalibrationError
from vgrd.geometry.least_squares import minimize

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_TOUCHES = (4, 5, 6, 8)  # few, where plain Gauss-Newton goes wrong
_SPREADS_DEG = (10.0, 30.0, 60.0, 180.0)  # as in the study of tilt
_OTHER_STARTS = 4  # beside the truth, so that a better minimum would hardly stay hidden
_WORSE = 1e-6  # of the cost: what the iteration leaves, as the bar of the gap
_WRONG = 1e-3  # of the cost: another minimum, not an iteration that ended early


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Whether each method ended above the lowest cost known, and the default's certificate."""
    rng = default_rng(seed)
    drawn = draw(rng, parameters["touches"], parameters["spread_deg"], planar=parameters["planar"])
    problem = drawn.problem
    equations = Equations(problem.points_in_object, problem.touches)
    starts = [drawn.object_from_base.rotation, *Rotation.random(_OTHER_STARTS, rng).as_matrix()]
    default = calibrate_universal(problem)
    plain = _plain_cost(problem)
    costs = [
        minimize(equations.linearize, retract, equations.start(R)).report.cost for R in starts
    ]
    lowest = min(default.report.cost, plain, *costs)
    return {
        "default_wrong": float(default.report.cost > lowest * (1 + _WORSE)),
        "plain_wrong": float(plain > lowest * (1 + _WRONG)),
        "gap": default.certificate.gap,
        "tight": float(default.certificate.tight),
    }


def _plain_cost(problem: UniversalProblem) -> float:
    """Cost where Eq. 9-15 end from X = identity, p_T = 0; infinite where they end nowhere."""
    try:
        return calibrate_universal(problem, "gauss-newton").report.cost
    except CalibrationError:
        return float("inf")


def _figures(trials: Trials) -> list[Figure]:
    wrong = trials.values("default_wrong")
    return [
        Figure("problems solved", float(len(wrong))),
        Figure("wrong optima, default", float(wrong.sum()), "", at_most=0),
        Figure("not certified", float(np.sum(1 - trials.values("tight"))), "", at_most=0),
        Figure("largest gap", float(trials.values("gap").max()), "", at_most=1e-6),
        *(
            Figure(f"plain Gauss-Newton wrong, {m} touches", _plain(trials, touches=m), "%")
            for m in _TOUCHES
        ),
        Figure("plain Gauss-Newton wrong, worst case", 100 * _rates(trials).max(), "%"),
    ]


def _plain(trials: Trials, **case: object) -> float:
    return 100 * trials.mean("plain_wrong", **case)


def _rates(trials: Trials) -> np.ndarray:
    """Share of wrong optima of plain Gauss-Newton: (planar, touches, spread)."""
    return np.array(
        [
            [
                [
                    trials.mean("plain_wrong", touches=m, spread_deg=s, planar=planar)
                    for s in _SPREADS_DEG
                ]
                for m in _TOUCHES
            ]
            for planar in (False, True)
        ]
    )


def _draw(trials: Trials) -> "Drawing":
    wrong = trials.values("default_wrong")
    labels = ("wrists turned by up to, degrees", "wrong optima, %")
    drawing, all_axes = panels(
        f"Wrong optima of plain Gauss-Newton from the identity; default: "
        f"{int(wrong.sum())} of {len(wrong)}",
        labels,
        labels,
    )
    rates = 100 * _rates(trials)
    places = np.arange(len(_SPREADS_DEG))
    for axes, block, targets in zip(all_axes, rates, ("spatial", "planar"), strict=True):
        for k, (m, row) in enumerate(zip(_TOUCHES, block, strict=True)):
            axes.bar(places + 0.2 * (k - 1.5), row, 0.19, color=COLORS[k], label=f"{m} touches")
        axes.set_xticks(places, [f"{s:g}" for s in _SPREADS_DEG])
        axes.set_ylim(0, max(1.0, 1.1 * float(rates.max())))
        axes.set_title(f"{targets} targets", fontsize=10)
        axes.grid(visible=False, axis="x")
    legend(all_axes[0])
    return drawing


STUDY = Study(
    name="certificate",
    title="Wrong optima of the universal method",
    cases=tuple(
        {"touches": m, "spread_deg": s, "planar": planar}
        for planar in (False, True)
        for m in _TOUCHES
        for s in _SPREADS_DEG
    ),
    runs=300,
    full_runs=10_000,
    trial=_trial,
    figures=_figures,
    most_refused=0.01,  # four touches within 10 degrees leave an unknown open now and then
    draw=_draw,
)
