"""Targets without CAD: how often the truth lies within the 95 % radius that is served for them.

The answer of the joint estimate, wrist fixed, for a target that only its own touch places: with four targets
in CAD beside it, and with none, where touches of one target with the wrist tilted tell the TCP. The turntable
is as far off its CAD as the joint estimate takes it to be. What CAD would bring is told as the advice does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.sessions import TILT_RAD
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.noise import COARSE
from fakes.world.simulation import BORED_CENTER_MM, WORK_ROTATION, Simulation
from vgrd.calibration.joint import calibrate_joint, expected_by_joint
from vgrd.calibration.planning import Job, errors_with_cad_mm
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.model import Plan, Policy, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_EVERY = tuple(f"P{i}" for i in range(1, 7))


@dataclass(frozen=True, slots=True)
class _Object:
    """bare: targets without CAD; tilted: what is touched with the wrist tilted, after all of them once."""

    bare: tuple[str, ...]
    tilted: tuple[str, ...]


_OBJECTS: Mapping[str, _Object] = MappingProxyType(
    {
        "mixed": _Object(bare=("P5", "P6"), tilted=("P1", "P2", "P3", "P4")),
        "without CAD": _Object(bare=_EVERY, tilted=("P1",) * 6),
    }
)
_BAR = (93.0, 97.0)  # %, 95 +- 2, as of the coverage study


def without_cad(recording: Recording, names: Sequence[str]) -> Recording:
    """The recording of a cell file that leaves out point_mm of these targets, and center_mm with the last."""
    spec = recording.facts.object
    targets = {
        name: replace(target, point_in_object=None) if name in names else target
        for name, target in spec.targets.items()
    }
    center = None if len(names) == len(targets) else spec.center_in_object
    changed = replace(spec, targets=MappingProxyType(targets), center_in_object=center)
    return replace(recording, facts=replace(recording.facts, object=changed))


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Squared miss over the stated radius (at most 1 is inside), and the radius with all of CAD."""
    kind = _OBJECTS[parameters["object"]]
    cell = Simulation(seed, vision=COARSE, center_sigma_mm=BORED_CENTER_MM)
    wrists = [WORK_ROTATION] * len(_EVERY) + [cell.wrist(TILT_RAD) for _ in kind.tilted]
    recording = without_cad(
        cell.record(wrists=wrists, names=[*_EVERY, *kind.tilted], plan=Plan.JOINT), kind.bare
    )
    name = kind.bare[int(cell.rng.integers(len(kind.bare)))]
    request = replace(cell.request(), target=name)
    fit = calibrate_joint(recording)
    answer = expected_by_joint(fit, name, request.seen, Policy.FIXED, WORK_ROTATION)
    miss = float(np.linalg.norm(cell.miss(request, answer.base_from_wrist)))
    job = Job(works=(WORK_ROTATION,), targets=(name,), angles_rad=(request.angle_rad,))
    with_cad = errors_with_cad_mm(fit, job)[name]
    return {"share": (miss / answer.u95_mm) ** 2, "u95": answer.u95_mm, "with CAD": with_cad}


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for kind in _OBJECTS:
        shares = trials.values("share", object=kind)
        inside = 100 * float(np.mean(shares <= 1)) if shares.size else float("nan")
        figures += [
            Figure(f"{kind}: within u95", inside, "%", *_BAR),
            Figure(f"{kind}: u95, mean", trials.mean("u95", object=kind), "mm"),
            Figure(
                f"{kind}: u95 with all of CAD, mean", trials.mean("with CAD", object=kind), "mm"
            ),
        ]
    return figures


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(object="mixed"))
    drawing, (axes,) = panels(
        f"Targets without CAD, {runs} calibrations each", ("miss / stated 95 % radius", "share, %")
    )
    for color, kind in zip(COLORS, _OBJECTS, strict=False):
        shares = np.sort(np.sqrt(trials.values("share", object=kind)))
        axes.plot(
            shares, 100 * (np.arange(len(shares)) + 1) / len(shares), color=color, label=kind
        )
    axes.axvline(1.0, color=PAPER, ls=(0, (5, 3)), linewidth=1)
    axes.axhline(95.0, color=PAPER, ls=(0, (5, 3)), linewidth=1)
    legend(axes)
    return drawing


STUDY = Study(
    name="bare-targets",
    title="Targets without CAD",
    cases=tuple({"object": kind} for kind in _OBJECTS),
    runs=400,
    full_runs=2000,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
