"""A session of plan plane or sphere from its start to its calibration, the robot a list of poses."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest

from fakes.studies.sessions import Session
from fakes.testing import ManualClock
from fakes.world.simulation import Simulation
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.recording.recorder import Recorder
from vgrd.cell.recording.teaching import Teaching
from vgrd.devices import FlangeReading
from vgrd.errors import InputError
from vgrd.model import Plan, Policy
from vgrd.solving.advisor import advise_folder
from vgrd.store.sessions import SampleKind, load_recording

SIGMA = SimpleNamespace(lateral_sigma_mm=0.233, axial_sigma_mm=0.233)


class Jogged:
    """Measuring of a robot that stands where the operator jogged it."""

    def __init__(self):
        self.pose = None
        self.robot = SimpleNamespace(newest=lambda _: FlangeReading(self.pose, None, 0.0, 0.0))

    async def rest(self):
        return self.pose


def taught(tmp_path, plan):
    """The folder, and the replies to every touch beside the object."""
    recording = Session(plan, points=16, looks=8).record(Simulation(8))
    measuring = Jogged()
    recorder = Recorder(tmp_path, ManualClock())
    teaching = Teaching(measuring, recorder, recording.facts, SIGMA)

    async def run():
        await teaching.start(plan.value, "s")
        replies = []
        for point in recording.points:
            measuring.pose = point.base_from_wrist
            replies.append(await teaching.point(point.target))
        for look in recording.looks:
            await recorder.call(lambda writer, look=look: writer.sample(SampleKind.LOOK, look))
        for touch in recording.touches:
            await recorder.call(lambda writer, touch=touch: writer.sample(SampleKind.TOUCH, touch))
        return replies, await teaching.stop()

    replies, end = asyncio.run(run())
    return tmp_path / "sessions" / end["session"], replies, end


@pytest.mark.parametrize("plan", [Plan.PLANE, Plan.SPHERE])
def test_a_surface_is_taught_counted_advised_and_solved(tmp_path, plan):
    folder, replies, end = taught(tmp_path, plan)
    assert [reply["missing"].get("point", 0) for reply in replies] == list(range(15, -1, -1))
    assert not end["missing"]
    recording = load_recording(folder)
    assert recording.plan is plan
    assert "nothing is missing" in advise_folder(folder, Policy.FIXED)["trouble"]
    calibration = calibrate_system(recording)
    assert calibration.verdict.ok
    apart = calibration.tcp.in_wrist - Simulation.tcp_in_wrist
    assert np.sqrt(apart @ np.linalg.solve(calibration.tcp.covariance, apart)) < 4


def test_a_plan_that_there_is_not_is_refused_with_those_that_there_are(tmp_path):
    facts = Simulation(1).facts()
    teaching = Teaching(Jogged(), Recorder(tmp_path, ManualClock()), facts, SIGMA)
    with pytest.raises(InputError, match="conventional, plane, sphere, joint"):
        asyncio.run(teaching.start("ball", "s"))
