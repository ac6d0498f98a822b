"""The expected error: the nominal session is solved by the joint estimate, its covariance told as of a real one."""

from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.joint import JointFit, calibrate_joint, tag_b_of
from vgrd.calibration.planning import Budget, Systematic, error_budget
from vgrd.geometry import Array
from vgrd.judging.operator_time import operator_minutes
from vgrd.model import CameraPlace, CellFacts, FlangeTag, Policy
from vgrd.solving.expectation.assumptions import Assumptions
from vgrd.solving.expectation.scene import Scene

TURNS_DEG = (0.0, 90.0, 180.0, 270.0)  # of the object since it was touched


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """What an expectation is drawn from: facts of the file and what it says of touches and the camera.

    touch_sigmas_mm: across and along the tool; stability: (6,) sigmas (mm, rad) of the camera's displacement
    since teaching, infinite where people move it.
    """

    facts: CellFacts
    stability: Array
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

    @property
    def budget(self) -> Budget:
        """Of every target at its worst turn."""
        worst, targets = self._radii.argmax(axis=0), range(len(self.targets))
        first = self.budgets[0]
        shares = np.array([self.budgets[k].shares[i] for k, i in zip(worst, targets, strict=True)])
        return Budget(
            first.targets, first.links, shares, self._radii.max(axis=0), first.irrelevant
        )

    @property
    def worst_turns_deg(self) -> tuple[float, ...]:
        """(t,) of the object."""
        return tuple(TURNS_DEG[k] for k in self._radii.argmax(axis=0))


def expect(cell: Cell, *, tag_a_in_view: bool = True) -> Expectation:
    """Foresee it, with tag A or without in the pictures of the answers.

    Raises InputError, TagNotSeen for a movable camera without tag A, and as `calibrate_joint` and `error_budget`
    where samples are too few.
    """
    scene = cell.scene
    fit = nominal_fit(scene)
    systematic = Systematic.of(
        scene.facts,
        print_share=0.0,  # `size_sigma_mm` of the tags counts, as the joint estimate refines it
        focal_share=cell.assumed.focal_percent / 100,
        center_px=cell.assumed.center_px,
        drift_mm=cell.assumed.drift_mm,
    )
    answers = [scene.answer(float(np.radians(turn))) for turn in TURNS_DEG]
    budgets = [
        error_budget(
            fit,
            tag_b_of(picture),
            cell.policy,
            systematic=systematic,
            targets=tuple(scene.points),
            place=CameraPlace(cell.stability, FlangeTag.of(picture) if tag_a_in_view else None),
        )
        for picture in answers
    ]
    return Expectation(tuple(budgets))


def nominal_fit(scene: Scene) -> JointFit:
    """The joint estimate of the session without noise: nothing to find and nobody to suspect in it."""
    return calibrate_joint(scene.recording(), robust=False, find_noise=False)
