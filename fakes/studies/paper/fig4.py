"""Figure 4: how the TCP error of the universal method is distributed, eight touches."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence, default_rng

from fakes.studies.paper.paper_data import draw
from fakes.studies.sampling import beside_the_paper, resampled
from fakes.studies.study import Figure, Parameters, Study, Trials
from vgrd.calibration.universal import calibrate_universal
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.geometry import Array
from vgrd.geometry.covariance import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_CALIBRATIONS = 2000  # the paper's
_BIN_MM = 0.05  # finer than the 0.1 to 0.2 mm in which the paper sees the mode


def tcp_error(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """TCP error of one calibration and its Cramer-Rao bound (rms), mm."""
    drawn = draw(default_rng(seed), parameters["touches"], parameters["spread_deg"])
    tcp = calibrate_universal(drawn.problem).tcp_in_wrist
    error = float(np.linalg.norm(tcp - drawn.tcp_in_wrist))
    return {"error_mm": error, "bound_mm": drawn.bound_mm()}


def _figures(trials: Trials) -> list[Figure]:
    errors = trials.values("error_mm")
    rms_mm, bound_mm = rms(errors), rms(trials.values("bound_mm"))
    mode = Figure("mode", _mode(errors), "mm", 0.10, 0.20, "0.1 to 0.2")
    largest = Figure("largest", float(errors.max()), "mm", 0.35, 0.55, "may exceed 0.4")
    return [
        beside_the_paper(mode, resampled(errors, _CALIBRATIONS, _mode), 0.1, 0.2),
        Figure("mean", float(errors.mean()), "mm", 0.15, 0.16),
        beside_the_paper(largest, resampled(errors, _CALIBRATIONS, _largest), 0.4, float("inf")),
        Figure("rms", rms_mm, "mm"),
        Figure("rms / Cramer-Rao bound", rms_mm / bound_mm, "", at_most=1.05),
        Figure("share below 0.3 mm", float(np.mean(errors < 0.3))),
    ]


def _mode(errors: Array) -> float:
    """Middle of the fullest bin of 0.05 mm."""
    counts = np.bincount((errors / _BIN_MM).astype(int))
    return float((np.argmax(counts) + 0.5) * _BIN_MM)


def _largest(errors: Array) -> float:
    return float(errors.max())


def _draw(trials: Trials) -> "Drawing":
    errors = trials.values("error_mm")
    drawing, (axes,) = panels(
        f"TCP error of the universal method, 8 touches, {len(errors)} calibrations (figure 4)",
        ("TCP error, mm", "calibrations"),
    )
    edges = np.arange(0, errors.max() + 0.02, 0.02)
    axes.hist(errors, edges.tolist(), color=COLORS[0], edgecolor="white")
    axes.axvline(errors.mean(), color=COLORS[1], label=f"mean {errors.mean():.3f} mm")
    axes.axvspan(0.1, 0.2, color=PAPER, alpha=0.10, lw=0, label="paper: most probable error")
    axes.axvline(
        0.4, color=PAPER, ls=(0, (5, 3)), lw=1.2, label="paper: the largest exceeds 0.4 mm"
    )
    axes.set_xlim(left=0)
    legend(axes, "upper right")
    return drawing


STUDY = Study(
    name="fig4",
    title="Figure 4: TCP error of the universal method with 8 touches",
    cases=({"touches": 8, "spread_deg": 180.0},),
    runs=_CALIBRATIONS,
    trial=tcp_error,
    figures=_figures,
    draw=_draw,
)
