"""One session, solved and served as the product does it, and judged against the truth."""

from collections.abc import Set
from dataclasses import dataclass

import numpy as np

from fakes.studies.cameras import FIXED, place_in
from fakes.world.simulation import WORK_ROTATION, SimulatedRequest, Simulation
from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import CalibrationError, Contradiction
from vgrd.model import Policy, Recording
from vgrd.solving.servable import unservable

REMARKS = frozenset({"flange_not_proven", "tcp_open", "meets_tolerance"})  # of good sessions too
_HOLDS = 0.9  # of a session's answers: of ten that state 95 % one may miss


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer: within: of its 95 % radius; links: named in its refusal, none where it was served."""

    within: bool
    u95_mm: float
    links: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Judged:
    """A session. told: codes of findings and names of links; answers: of a calibration, rejected or not."""

    accepted: bool
    told: frozenset[str]
    answers: tuple[Answer, ...] = ()

    @property
    def within(self) -> float:
        """Share of the answers within their radius, served or not; NaN without any."""
        return float(np.mean([a.within for a in self.answers])) if self.answers else np.nan

    @property
    def u95_mm(self) -> float:
        """Mean radius."""
        return float(np.mean([a.u95_mm for a in self.answers])) if self.answers else np.nan

    @property
    def refused(self) -> float:
        """Share of the answers that nobody is given."""
        if not (self.accepted and self.answers):
            return 1.0
        return float(np.mean([bool(answer.links) for answer in self.answers]))

    @property
    def holds(self) -> bool:
        """Whether its answers lie within their radii as often as chance lets them."""
        return self.within >= _HOLDS

    @property
    def misses_refused(self) -> bool:
        """Whether nothing that misses is served."""
        return not self.accepted or all(a.within or a.links for a in self.answers)

    def row(self, causes: Set[str]) -> dict[str, float | str]:
        """Columns of the study; causes: what tells the misfit rightly."""
        alarms = self.told - REMARKS
        named = bool(alarms & causes)
        return {
            "within": self.within,
            "u95_mm": self.u95_mm,
            "rejected": float(not self.accepted),
            "answers_refused": self.refused,
            "holds": float(self.holds),
            "told": float(bool(alarms)),
            "named": float(named),
            "caught": float(named and self.misses_refused),
            "needless": float(self.holds and self.refused > 1 - _HOLDS),
            "codes": ";".join(sorted(alarms)),
        }


def judge(cell: Simulation, recording: Recording, requests: int) -> Judged:
    """Solve a session as `vgrd solve` does, and ask for coordinates at new turns of the object."""
    try:
        calibration = calibrate_system(recording, stability=FIXED)
    except CalibrationError as err:
        return Judged(False, frozenset({type(err).__name__}))
    findings = (*calibration.verdict.findings, *unservable(calibration, Policy.FIXED))
    answers = tuple(_answer(cell, calibration, cell.request()) for _ in range(requests))
    told = {finding.code for finding in findings} | {link for a in answers for link in a.links}
    return Judged(not any(finding.fatal for finding in findings), frozenset(told), answers)


def _answer(cell: Simulation, calibration: Calibration, request: SimulatedRequest) -> Answer:
    """What is served; what would be, where it is refused."""
    tag_b, place = request.seen.tag_b, place_in(request.seen, FIXED)
    if tag_b is None:
        raise CalibrationError("tag B is not in the picture")
    links: tuple[str, ...] = ()
    try:
        expected = expected_coordinate(
            calibration, request.target, tag_b, Policy.FIXED, WORK_ROTATION, place
        )
    except Contradiction as err:
        links = err.links
        expected = calibration.solution.expected(
            calibration.facts,
            calibration.taught[request.target],
            tag_b,
            Policy.FIXED,
            WORK_ROTATION,
            place,
        )
    miss_mm = float(np.linalg.norm(cell.miss(request, expected.base_from_wrist)))
    return Answer(miss_mm <= expected.u95_mm, expected.u95_mm, links)
