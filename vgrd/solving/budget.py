"""The error budget of a recorded session: solved jointly, then shared out among the chain's links."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.joint import calibrate_joint
from vgrd.calibration.planning import Budget, Systematic, error_budget, picture_of
from vgrd.geometry import exp_rotation
from vgrd.model import Policy, Recording


def session_budget(
    recording: Recording,
    targets: Sequence[str] | None,
    policy: Policy,
    work_rotvec_deg: Sequence[float] | None,
    turn_deg: float,
    quanta: tuple[float, float],
    systematic: Systematic,
) -> Budget:
    """Budget of the targets (all without a choice) for an object that turned by turn_deg since.

    work_rotvec_deg: (3,) wrist at work in the base, None as touched; quanta: steps in mm and degrees to
    which the robot rounds its poses. Raises InputError and what `calibrate_joint` raises.
    """
    arm = replace(
        recording.facts.arm,
        quantum_mm=quanta[0],
        quantum_rad=float(np.radians(quanta[1])),
    )
    result = calibrate_joint(recording, arm=arm)
    work = None if work_rotvec_deg is None else exp_rotation(np.radians(work_rotvec_deg))
    now = picture_of(result, float(np.radians(turn_deg)))
    return error_budget(result, now, policy, work, systematic, targets)
