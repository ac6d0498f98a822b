"""Figure 3 as sessions: plans conventional, plane and sphere taught, solved and served in experiment B's cell.

The same looks and touches of the object, and as many touches beside it: of one fixed point, of a plate, of a ball. What
is served goes back to the wrist of the touches, where most of the TCP's error cancels, and to wrists that are turned.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence
from scipy.spatial.transform import Rotation

from fakes.studies.paper.baselines import tag_b_in
from fakes.studies.sessions import TILT_RAD, Session
from fakes.studies.study import REFUSED, Figure, Parameters, Study, Trials
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.charts import COLORS, PAPER, panels
from vgrd.model import Plan, Policy

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_PLANS = (Plan.CONVENTIONAL, Plan.PLANE, Plan.SPHERE)
_POINTS = 16  # as the daemon asks for of a plane or a ball
_TURNED = WORK_ROTATION @ Rotation.from_euler("y", TILT_RAD).as_matrix()
_WRISTS = {"wrist as touched": WORK_ROTATION, "wrist tilted": _TURNED}


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Errors of the TCP and of one answer at each wrist, mm; whether the stated radius holds it."""
    cell = Simulation(seed)
    recording = Session(parameters["plan"], points=_POINTS, looks=8).record(cell)
    calibration = calibrate_system(recording)
    tcp = calibration.solution.tcp
    row = {
        "TCP": float("nan")
        if tcp is None
        else float(np.linalg.norm(tcp.in_wrist - cell.tcp_in_wrist))
    }
    for name, R in _WRISTS.items():
        request = cell.request()
        seen = tag_b_in(request.seen)
        served = expected_coordinate(calibration, request.target, seen, Policy.REQUESTED, R)
        miss_mm = float(np.linalg.norm(cell.miss(request, served.base_from_wrist)))
        row |= {name: miss_mm, f"{name}, holds": float(miss_mm <= served.u95_mm)}
    return row


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for plan in _PLANS:
        figures.append(
            Figure(f"{plan}: mean error of the TCP", trials.mean("TCP", plan=plan), "mm")
        )
        for name in _WRISTS:
            mean = trials.mean(name, plan=plan)
            figures.append(Figure(f"{plan}: mean miss, {name}", mean, "mm"))
            holds = 100 * trials.mean(f"{name}, holds", plan=plan)
            figures.append(Figure(f"{plan}: radius holds, {name}", holds, "%"))
        refused = sum(row[REFUSED] for row in trials.select(plan=plan))
        figures.append(Figure(f"{plan}: refused", float(refused)))
    holds = 100 * float(np.mean([trials.mean(f"{name}, holds") for name in _WRISTS]))
    return [*figures, Figure("radius holds, all", holds, "%", 93, 97)]


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(plan=Plan.PLANE))
    drawing, all_axes = panels(
        f"Expected coordinate by the contact that gives the TCP, {runs} sessions each (figure 3)",
        *[("", f"miss, {name}, mm") for name in _WRISTS],
    )
    for axes, name in zip(all_axes, _WRISTS, strict=True):
        values = [trials.values(name, plan=plan) for plan in _PLANS]
        boxes = axes.boxplot(
            values, tick_labels=list(_PLANS), widths=0.5, patch_artist=True, showfliers=False
        )
        for middle in boxes["medians"]:
            middle.set(color=PAPER)
        for color, box in zip(COLORS, boxes["boxes"], strict=False):
            box.set(facecolor=color, alpha=0.55)
        axes.set_ylim(bottom=0)
    return drawing


STUDY = Study(
    name="contact-plans",
    title="Figure 3 as sessions: plans conventional, plane and sphere, taught and served",
    cases=tuple({"plan": plan} for plan in _PLANS),
    runs=200,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
