"""A link that slipped after teaching: how often pictures refuse it, and whether the true link is named.

Slips have random directions and just the size at which the picture is expected to misfit by 1 to 10 sigma (the
square root of what the slip adds to the misfit). One picture, or a cell that was watched for 36 s before and after.
"""

from copy import deepcopy
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.cameras import FIXED, MOVABLE
from fakes.studies.movement.visits import Visits, slipped
from fakes.studies.sessions import Session, known_arm
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import BORED_CENTER_MM, SimulatedRequest, Simulation
from vgrd.calibration.joint import JointSolution, calibrate_joint, solution_of
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.geometry import Array, Pose
from vgrd.model import (
    CameraPlace,
    CellFacts,
    FlangeTag,
    Link,
    LinkReport,
    Plan,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(Plan.JOINT, looks=8, spins=10, touches=10, tilted=4)
_ARM = ArmErrors(sigma_mm=0.03, field_mm=0.15)
_STABILITIES = {"fixed": FIXED, "movable": MOVABLE}
_SIGMAS = (1, 2, 3, 4, 5, 6, 8, 10)  # from what no picture tells to what every one does
_PROBE = 0.1  # of a slip of 1 mm and 2 mrad: small enough for a parabola
_SLIP = np.array([1.0] * 3 + [2e-3] * 3)
_JUDGED = 5  # sigmas at which the bars hold
_WATCHED_SIGMAS = (1, 2, 3, 4, 5, 8)
_POSES, _VISITS = 3, 12  # before the slip, and after it: 36 s


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """By sigmas of expected misfit: refused or not, and the true link among those named or not."""
    cell = Simulation(seed, vision=FINE, arm=_ARM, center_sigma_mm=BORED_CENTER_MM)
    recording = _SESSION.record(cell)
    solution = solution_of(calibrate_joint(recording, arm=known_arm(_ARM)))
    link, is_hidden = Link(parameters["link"]), parameters["tag_a"] == "hidden"
    picture = _Picture(
        solution,
        recording.facts,
        cell.request(),
        link,
        _STABILITIES[parameters["stability"]],
        is_hidden,
    )
    direction = cell.rng.normal(size=6) * _SLIP
    at_rest = picture.report(np.zeros(6))
    there, back = (picture.report(sign * _PROBE * direction) for sign in (1, -1))
    growth = (there.misfit + back.misfit - 2 * at_rest.misfit) / (2 * _PROBE**2)
    out = {"refused at rest": float(not at_rest.fits)}
    for sigmas in _SIGMAS:
        report = picture.report(direction * sigmas / np.sqrt(growth))
        out[f"refused at {sigmas}"] = float(not report.fits)
        out[f"named at {sigmas}"] = float(link in report.suspects) if not report.fits else np.nan
    stability = _STABILITIES[parameters["stability"]]
    visits = Visits(
        cell, solution, recording.facts, stability, poses=_POSES, has_tag_a=not is_hidden
    )
    out["alarms before"] = float(sum(not report.fits for report in visits.go(_VISITS)))
    for sigmas in _WATCHED_SIGMAS:
        slip = Pose.exp(direction * sigmas / np.sqrt(growth))
        refused = next((r for r in deepcopy(visits).go(_VISITS, slip, link) if not r.fits), None)
        out[f"refused in time at {sigmas}"] = float(refused is not None)
        is_named = np.nan if refused is None else float(link in refused.suspects)
        out[f"named in time at {sigmas}"] = is_named
    return out


class _Picture:
    """One picture with its noise, in which a link slips by what is asked."""

    def __init__(
        self,
        solution: JointSolution,
        facts: CellFacts,
        request: SimulatedRequest,
        link: Link,
        stability: Array,
        is_hidden: bool,
    ) -> None:
        self._solution, self._facts = solution, facts
        self._request, self._link = request, link
        self._stability, self._is_hidden = stability, is_hidden

    def report(self, slip: Array) -> LinkReport:
        """Slips of tags are in the tag's frame, of the camera in its own."""
        tag_a, tag_b = slipped(self._request.seen, self._link, Pose.exp(slip))
        seen = None if self._is_hidden else FlangeTag(tag_a, self._request.seen.base_from_wrist)
        return self._solution.examine(self._facts, tag_b, CameraPlace(self._stability, seen))


def _figures(trials: Trials) -> list[Figure]:
    out = []
    for case in _CASES:
        where = f"{case['link']} slips, camera {case['stability']}, tag A {case['tag_a']}"
        for sigmas in _SIGMAS:
            refused = 100 * trials.mean(f"refused at {sigmas}", **case)
            out.append(Figure(f"{where}: refused by one picture at {sigmas} sigma", refused, "%"))
        for sigmas in _WATCHED_SIGMAS:
            refused = 100 * trials.mean(f"refused in time at {sigmas}", **case)
            bar = 95.0 if sigmas == _JUDGED else None
            out.append(
                Figure(
                    f"{where}: refused within 36 s at {sigmas} sigma", refused, "%", at_least=bar
                )
            )
        share = 100 * trials.finite_mean(f"named in time at {_JUDGED}", **case)
        out.append(Figure(f"{where}: named at {_JUDGED} sigma", share, "%", at_least=95.0))
    wrong = 100 * float(np.mean(trials.values("refused at rest")))
    out.append(Figure("a good cell: refused by the first picture", wrong, "%", at_most=0.05))
    alarms = float(np.sum(trials.values("alarms before")))
    out.append(Figure("a good cell: pictures refused before the slip", alarms, at_most=0))
    return out


def _draw(trials: Trials) -> "Drawing":
    drawing, (alone, watched) = panels(
        f"A link that slipped, {len(trials.select())} cells",
        ("expected misfit of one picture, sigma", "refused by one picture, %"),
        ("expected misfit of one picture, sigma", "refused within 36 s, %"),
    )
    for color, case in zip(COLORS * 2, _CASES, strict=False):
        label = f"{case['link']}, {case['stability']}, tag A {case['tag_a']}"
        for axes, what, many in (
            (alone, "refused at", _SIGMAS),
            (watched, "refused in time at", _WATCHED_SIGMAS),
        ):
            shares = [100 * trials.finite_mean(f"{what} {sigmas}", **case) for sigmas in many]
            axes.plot(many, shares, color=color, marker="o", label=label)
            axes.axhline(95, color=PAPER, ls=(0, (5, 3)), linewidth=1)
    legend(alone)
    return drawing


_CASES = tuple(
    {"link": link.value, "stability": stability, "tag_a": tag_a}
    for link, stability, tag_a in (
        (Link.TAG_B, "fixed", "seen"),
        (Link.TAG_A, "fixed", "seen"),
        (Link.TAG_B, "fixed", "hidden"),
        (Link.CAMERA, "fixed", "hidden"),
        (Link.TAG_B, "movable", "seen"),
        (Link.TAG_A, "movable", "seen"),
    )
)

STUDY = Study(
    name="moved-links",
    title="A link that slipped after teaching",
    cases=_CASES,
    runs=300,
    full_runs=2000,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
