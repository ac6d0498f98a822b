"""Teaching sessions that the studies compare, recorded in the simulated cell, and what they cost."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import Simulation
from vgrd.judging.operator_time import MINUTES
from vgrd.model import ArmModel, Plan, Recording

TILT_RAD = np.radians(25)  # within the 30 degrees that an operator reaches
STEP_MINUTES: Mapping[str, float] = MappingProxyType(  # rows of the paper's table 4
    {
        "TCP": MINUTES["point"],
        "hand-eye": MINUTES["look"],
        "turntable": MINUTES["spin"],
        "touches": MINUTES["touch"],
    }
)


@dataclass(frozen=True, slots=True)
class Session:
    """How many samples of each kind are taught; tilted touches come after those at work orientation.

    turned: how many touches, the last ones, are taken after the object was turned half round.
    """

    plan: Plan
    points: int = 0
    looks: int = 0
    spins: int = 0
    touches: int = 6  # each target once
    tilted: int = 0
    turned: int = 0

    def record(self, cell: Simulation) -> Recording:
        """Teach it."""
        fixed = self.touches - self.tilted
        wrists = [cell.wrist() for _ in range(fixed)]
        wrists += [cell.wrist(TILT_RAD) for _ in range(self.tilted)]
        return cell.record(
            plan=self.plan,
            wrists=wrists,
            turns_rad=[0.0] * (self.touches - self.turned) + [np.pi] * self.turned,
            looks=self.looks,
            spins=self.spins,
            points=self.points,
        )


SESSIONS: Mapping[str, Session] = (
    MappingProxyType(  # the paper's two, with its other contacts too, and shorter ones
        {
            "conventional": Session(Plan.CONVENTIONAL, points=10, looks=8),
            "plane": Session(Plan.PLANE, points=16, looks=8),
            "ball": Session(Plan.SPHERE, points=16, looks=8),
            "special": Session(Plan.SPECIAL, looks=8, spins=10),
            "joint, fixed wrist": Session(Plan.JOINT, looks=8, spins=10),
            "joint, no hand-eye step": Session(Plan.JOINT, spins=4, tilted=3),
        }
    )
)


def known_arm(arm: ArmErrors) -> ArmModel:
    """What the joint estimate is told of an arm whose sizes of errors are known."""
    least_mm = 1e-3  # of the repeatability: an exact arm too has the last digit of its report
    return ArmModel(max(arm.sigma_mm, least_mm), arm.field_mm, arm.length_mm, arm.rad_per_mm)


def operator_minutes(recording: Recording) -> dict[str, float]:
    """Minutes by step, at table 4's cost of one sample."""
    counts = {
        "TCP": len(recording.points),
        "hand-eye": len(recording.looks),
        "turntable": len(recording.spins),
        "touches": len(recording.touches),
    }
    return {step: STEP_MINUTES[step] * count for step, count in counts.items()}
