"""Five calibrations of one cell by each of the paper's methods, and what they answer for one target.

As experiment B: the same looks and touches serve both methods, the conventional one has a fixed point and the special
one a turning table besides. One picture of the turned object is answered with every calibration.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fakes.studies.paper.arms import CALIBRATIONS, record_session
from fakes.studies.paper.baselines import CONVENTIONAL, SPECIAL, paper_methods
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.geometry import Array

METHODS = (CONVENTIONAL, SPECIAL)
PLACEMENTS = 8  # of one hole, as figure 10 (a) has them


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """Expected coordinates by method, (5, 2) each, and the true one, (2,); x and y in the base, mm."""

    by_method: Mapping[str, Array]
    truth: Array

    def from_mean_mm(self, method: str) -> Array:
        """The paper's error (5,): distance to the mean of the five."""
        answers = self.by_method[method]
        return np.asarray(np.linalg.norm(answers - answers.mean(axis=0), axis=1))

    def from_truth_mm(self, method: str) -> Array:
        """Ours (5,): distance to where the flange truly has to be."""
        return np.asarray(np.linalg.norm(self.by_method[method] - self.truth, axis=1))


def repeated_answers(cell: Simulation, arm: str) -> Answers:
    """One target in one picture, answered with every calibration; raises what a method refuses."""
    request = cell.request()
    answers: dict[str, list[Array]] = {name: [] for name in METHODS}
    for _ in range(CALIBRATIONS):
        methods = paper_methods(record_session(cell, arm))
        for name, found in answers.items():
            found.append(methods[name](request.target, request.seen)[:2])
    truth = cell.flange(request.target, request.angle_rad, WORK_ROTATION)
    return Answers({name: np.array(found) for name, found in answers.items()}, truth[:2])


def placements(cell: Simulation) -> Array:
    """Flange (8, 2) in the base, mm, after one hole was met again and again with the same wrist."""
    touches = [cell.touch("P1", WORK_ROTATION) for _ in range(PLACEMENTS)]
    return np.array([touch.base_from_wrist.translation[:2] for touch in touches])
