"""Eq. 9-15 as printed: Gauss-Newton from the identity, against the answer with a certificate.

A TCP is wrong where it lies elsewhere than the certified one by more than a millimetre: both fit the same touches,
and what they differ by is no noise. Any orientation is the paper's own simulation (figures 4 and 5).
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence, default_rng

from fakes.studies.paper.paper_data import draw
from fakes.studies.study import Figure, Parameters, Study, Trials
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.charts import COLORS, legend, panels, plain_log_ticks
from vgrd.errors import CalibrationError
from vgrd.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_TOUCHES = (4, 5, 6, 7, 8, 12, 16)  # from the fewest that determine it to where none is wrong
_SPREADS_DEG = (30.0, 180.0)  # what an operator reaches, and the paper's
_FEW = _TOUCHES[:2]  # where it goes wrong
_METHODS = ("plain", "certified")
_WRONG_MM = 1.0  # from the certified TCP: above the millionths that the iteration leaves


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Errors (26) of both TCPs, mm; infinite where Gauss-Newton ended nowhere."""
    drawn = draw(default_rng(seed), parameters["touches"], parameters["spread_deg"])
    certified = calibrate_universal(drawn.problem)
    plain = _plain_tcp(drawn.problem)
    return {
        "wrong": float(not np.linalg.norm(plain - certified.tcp_in_wrist) <= _WRONG_MM),
        "nowhere": float(not np.isfinite(plain).all()),
        "plain_mm": float(np.linalg.norm(plain - drawn.tcp_in_wrist)),
        "certified_mm": float(np.linalg.norm(certified.tcp_in_wrist - drawn.tcp_in_wrist)),
        "tight": float(certified.certificate.tight),
    }


def _plain_tcp(problem: UniversalProblem) -> Array:
    """TCP (3,) where Eq. 9-15 end from X = identity, p_T = 0; infinite where they end nowhere."""
    try:
        return calibrate_universal(problem, "gauss-newton").tcp_in_wrist
    except CalibrationError:
        return np.full(3, np.inf)


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for spread in _SPREADS_DEG:
        for m in _TOUCHES:
            case = {"touches": m, "spread_deg": spread}
            where = f"{m} touches within {spread:g} degrees"
            wrong = 100 * trials.mean("wrong", **case)
            figures.append(Figure(f"{where}: Gauss-Newton wrong", wrong, "%"))
            for name in _METHODS if m in _FEW else ():
                high = _high(trials.values(f"{name}_mm", **case))
                figures.append(Figure(f"{where}: 95 % of errors below, {name}", high, "mm"))
    nowhere = 100 * trials.mean("nowhere")
    uncertified = float(np.sum(1 - trials.values("tight")))
    return [
        *figures,
        Figure("Gauss-Newton ended nowhere", nowhere, "%"),
        Figure("answers without a certificate", uncertified, "", at_most=0),
    ]


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(touches=8, spread_deg=180.0))
    drawing, (shares, errors) = panels(
        f"Gauss-Newton from the identity, {runs} calibrations each (Eq. 9-15)",
        ("touches", "wrong answers, %"),
        ("touches", "TCP error below which 95 % lie, mm"),
    )
    for color, spread in zip(COLORS, _SPREADS_DEG, strict=False):
        label = f"within {spread:g} degrees"
        cases = [{"touches": m, "spread_deg": spread} for m in _TOUCHES]
        wrong = [100 * trials.mean("wrong", **case) for case in cases]
        shares.plot(_TOUCHES, wrong, "o-", color=color, label=label)
        for name, style in zip(_METHODS, ("o-", "s:"), strict=True):
            high = [_high(trials.values(f"{name}_mm", **case)) for case in cases]
            errors.plot(_TOUCHES, high, style, color=color, label=f"{name}, {label}")
    shares.set_ylim(bottom=0)
    plain_log_ticks(errors, (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000), x=False)
    for axes in (shares, errors):
        axes.set_xticks(_TOUCHES)
        legend(axes, "upper right")
    return drawing


def _high(errors_mm: Array) -> float:
    """The 95th percentile of those that are numbers."""
    known = errors_mm[np.isfinite(errors_mm)]
    return float(np.percentile(known, 95)) if known.size else float("nan")


STUDY = Study(
    name="eq9",
    title="Eq. 9-15 as printed: wrong answers of Gauss-Newton from the identity",
    cases=tuple({"touches": m, "spread_deg": s} for s in _SPREADS_DEG for m in _TOUCHES),
    runs=300,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
