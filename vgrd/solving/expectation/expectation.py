"""The expected error: the nominal session is solved by the joint estimate, its covariance told as of a real one."""

from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.joint import JointFit, calibrate_joint
from vgrd.calibration.planning import Budget, Systematic, error_budget
from vgrd.geometry import Array
from vgrd.judging.operator_time import operator_minutes
from vgrd.model import CellFacts, Policy
from vgrd.solving.expectation.assumptions import Assumptions
from vgrd.solving.expectation.scene import Scene

TURNS_DEG = (0.0, 90.0, 180.0, 270.0)  # of the object since it was touched


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """What an expectation is drawn from: facts of the file, sigmas of a touch across and along the tool, mm."""

    facts: CellFacts
    touch_sigmas_mm: tuple[float, float]
    policy: Policy
    assumed: Assumptions

    @property
    def scene(self) -> Scene:
        """Laid out; InputError where it cannot be."""
        facts = replace(self.facts, robot_sigma_mm=self.arm_mm)
        return Scene.of(facts, self.touch_sigmas_mm, self.assumed)

    @property
    def arm_mm(self) -> float:
        """Absolute error of the arm, 1 sigma."""
        return self.assumed.arm_mm or self.facts.robot_sigma_mm

    def minutes(self) -> dict[str, float]:
        """Of the operator, by kind of sample."""
        assumed = self.assumed
        counts = {"look": assumed.looks, "spin": assumed.spins, "touch": assumed.touches}
        return operator_minutes(counts)


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """The error budget at each of `TURNS_DEG`."""

    budgets: tuple[Budget, ...]

    @property
    def targets(self) -> tuple[str, ...]:
        """Names."""
        return self.budgets[0].targets

    @property
    def _radii(self) -> Array:
        """(turns, t), mm."""
        return np.array([budget.u95_mm for budget in self.budgets])

    @property
    def u95_mm(self) -> dict[str, float]:
        """95 % error by target, at the worst turn."""
        return dict(zip(self.targets, map(float, self._radii.max(axis=0)), strict=True))

    @property
    def worst(self) -> str:
        """The target with the largest error."""
        errors = self.u95_mm
        return max(errors, key=errors.__getitem__)

    @property
    def worst_mm(self) -> float:
        """Its error."""
        return self.u95_mm[self.worst]

    def rows(self) -> list[dict[str, str | float]]:
        """By target: the row of its budget at the worst turn, and that turn."""
        worst = self._radii.argmax(axis=0)
        return [
            {**self.budgets[k].rows()[i], "turn_deg": TURNS_DEG[k]} for i, k in enumerate(worst)
        ]

    @property
    def links(self) -> list[str]:
        """Of the chain, as the rows name them."""
        return [str(link) for link in self.budgets[0].links]


def expect(cell: Cell) -> Expectation:
    """Foresee it; raises InputError, and as `calibrate_joint` and `error_budget` where samples are too few."""
    scene = cell.scene
    fit = nominal_fit(scene)
    systematic = Systematic.of(
        scene.facts,
        focal_share=cell.assumed.focal_percent / 100,
        center_px=cell.assumed.center_px,
        drift_mm=cell.assumed.drift_mm,
    )
    budgets = [
        error_budget(
            fit,
            scene.seen_now(float(np.radians(turn))),
            cell.policy,
            systematic=systematic,
            targets=tuple(scene.points),
        )
        for turn in TURNS_DEG
    ]
    return Expectation(tuple(budgets))


def nominal_fit(scene: Scene) -> JointFit:
    """The joint estimate of the session without noise: nothing to find and nobody to suspect in it."""
    return calibrate_joint(scene.recording(), robust=False, find_noise=False)
