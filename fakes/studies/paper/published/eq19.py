"""Eq. 16 and 19 as printed: what the sign and a flange that moved between the pictures cost.

The paper's samples in experiment B's cell, coarse vision. At run time the flange stands elsewhere than in the
calibration picture, its orientation kept. Eq. 16 as printed adds the TCP that has to be taken off. With the sign
mended it needs no displacement, since it uses where tag A is now; Eq. 19 takes tag A to be where it was.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.paper.arms import EXACT, record_session
from fakes.studies.paper.baselines import (
    both_tags,
    first_touch,
    fitted_cad,
    pivot_in_tag,
    solved_hand_eye,
)
from fakes.studies.paper.published.equations import equation_16, equation_19
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.stepwise import special_expected
from vgrd.calibration.tcp import calibrate_fixed_point
from vgrd.calibration.touches import arm_touches
from vgrd.charts import COLORS, legend, panels, plain_log_ticks
from vgrd.geometry import Array, Pose
from vgrd.model import Observation, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

PRINTED_16, MENDED_16 = "Eq. 16", "Eq. 16, sign mended"
PRINTED_19, OURS = "Eq. 19", "Eq. 19 with the displacement"
METHODS = (PRINTED_16, MENDED_16, PRINTED_19, OURS)
_MOVED_MM = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # from at rest to across the object
_FAR_MM = _MOVED_MM[-1]
_LOG_TICKS = (0.1, 1, 10, 100)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Error (27) of the answers for one target, mm, by equation; and twice the length of the TCP."""
    cell = Simulation(seed)
    recording = record_session(cell, EXACT)
    target, angle = f"P{cell.rng.integers(6) + 1}", float(cell.rng.uniform(-np.pi, np.pi))
    direction = cell.rng.normal(size=3)
    shift = parameters["moved_mm"] * direction / np.linalg.norm(direction)
    stood = first_touch(recording, target).base_from_wrist
    now = cell.observe(Pose(stood.rotation, stood.translation + shift), angle)
    truth = cell.flange(target, angle, WORK_ROTATION)
    row = {
        name: float(np.linalg.norm(answer - truth))
        for name, answer in answers(recording, target, now).items()
    }
    return {**row, "twice the TCP": 2 * float(np.linalg.norm(cell.tcp_in_wrist))}


def answers(recording: Recording, target: str, now: Observation) -> Mapping[str, Array]:
    """Flange (3,) for the target in the picture `now` by every equation, mm."""
    touch = first_touch(recording, target)
    A0, B0 = both_tags(touch.observation)
    A1, B1 = both_tags(now)
    ref, seen = A0.inverse() @ B0, A1.inverse() @ B1
    hand_eye, fit = solved_hand_eye(recording).mount_from_target, fitted_cad(recording)
    center = np.asarray(recording.facts.object.center_in_object)
    pivot, pivot_flange = pivot_in_tag(recording), fit.flange(center)
    tcp = calibrate_fixed_point(arm_touches(recording.points, recording)).tcp_in_wrist
    flange, R = touch.base_from_wrist.translation, touch.base_from_wrist.rotation
    by_tcp = (now.base_from_wrist @ hand_eye, seen, ref, hand_eye.inverse() @ tcp)
    return {
        PRINTED_16: equation_16(*by_tcp, R @ tcp),
        MENDED_16: equation_16(*by_tcp, -R @ tcp),
        PRINTED_19: equation_19(R @ hand_eye.rotation, seen, ref, pivot, flange, pivot_flange),
        OURS: special_expected(
            base_from_wrist_ref=touch.base_from_wrist,
            base_from_wrist_now=now.base_from_wrist,
            tag_a_from_tag_b_ref=ref,
            tag_a_from_tag_b_now=seen,
            R_wrist_from_tag_a=hand_eye.rotation,
            pivot_in_tag_b=pivot,
            flange_ref=flange,
            pivot_flange_ref=pivot_flange,
        ),
    }


def _figures(trials: Trials) -> list[Figure]:
    figures = [
        Figure(f"moved by {moved:g} mm: {name}", trials.mean(name, moved_mm=moved), "mm")
        for moved in (0.0, 1.0, 10.0, _FAR_MM)
        for name in METHODS
    ]
    far, rest = ({n: trials.mean(n, moved_mm=d) for n in METHODS} for d in (_FAR_MM, 0.0))
    sign = rest[PRINTED_16] / trials.mean("twice the TCP")
    return [
        *figures,
        Figure("Eq. 16 at rest / twice the TCP", sign, "", 0.98, 1.02),
        Figure("Eq. 19 / way of the flange, 100 mm", far[PRINTED_19] / _FAR_MM, "", 0.98, 1.02),
        Figure("with the displacement: 100 mm / at rest", far[OURS] / rest[OURS], "", 0.8, 1.2),
    ]


def _draw(trials: Trials) -> "Drawing":
    moved = np.array(_MOVED_MM[1:])  # a logarithm has no place for 0
    drawing, (axes,) = panels(
        f"Expected coordinate when the flange has moved, {len(trials.select(moved_mm=1.0))} each "
        "(Eq. 16, 19)",
        ("the flange moved between the pictures by, mm", "mean error, mm"),
    )
    for color, name in zip(COLORS, METHODS, strict=False):
        errors = [trials.mean(name, moved_mm=d) for d in moved]
        label = f"{name} as printed" if name in (PRINTED_16, PRINTED_19) else name
        axes.plot(moved, errors, "o-", color=color, label=label)
    plain_log_ticks(axes, _LOG_TICKS, x=True)
    plain_log_ticks(axes, (0.2, 0.5, *_LOG_TICKS[1:]), x=False)
    legend(axes)
    return drawing


STUDY = Study(
    name="eq19",
    title="Eq. 16 and 19 as printed: the sign, and a flange that moved between the pictures",
    cases=tuple({"moved_mm": moved} for moved in _MOVED_MM),
    runs=200,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
