"""A recorded session that was verified."""

from pathlib import Path

import numpy as np

from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.model import Plan
from vgrd.store.sessions import SampleKind, SessionWriter

TURNED = (1.2, 2.8)  # of the object at the verifications, rad


def recorded(state_dir: Path, name: str = "one") -> Path:
    """A session with two verifications and one picture, taught in the simulated cell."""
    sim = Simulation(3)
    wrists = [WORK_ROTATION] * 3 + [sim.wrist(np.radians(25)) for _ in range(3)]
    recording = sim.record(wrists=wrists, plan=Plan.JOINT, looks=0, spins=4, points=0)
    verifications = [sim.touch("P2", WORK_ROTATION, angle) for angle in TURNED]
    with SessionWriter(state_dir, name, Plan.JOINT, recording.facts, ManualClock()) as writer:
        for kind, samples in (
            (SampleKind.SPIN, recording.spins),
            (SampleKind.TOUCH, recording.touches),
            (SampleKind.VERIFY, verifications),
        ):
            for sample in samples:
                writer.sample(kind, sample)
    return writer.path
