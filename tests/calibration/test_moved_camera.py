"""The paper's plans with a camera that moved: the same chain, the same refusals."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import Contradiction, TagNotSeen
from vgrd.geometry import Pose
from vgrd.model import CameraPlace, FlangeTag, Plan, Policy, frozen_array

PERFECT = Vision(1e-6, 1e-6, 1e-7, 1e-7)
FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
ANYWHERE = frozen_array([np.inf] * 6, 6)
KNOCK = Pose.from_rotvec((0.003, -0.004, 0.001), (3.0, -4.0, 1.0))
FAR = Pose.from_rotvec((0.2, -0.1, 0.3), (100.0, -80.0, 50.0))


@pytest.fixture(scope="module", params=[Plan.UNIVERSAL, Plan.SPECIAL, Plan.JOINT])
def taught(request):
    sim = Simulation(2, vision=PERFECT, touch_sigma_mm=0.0)
    tilts = [] if request.param is Plan.SPECIAL else [sim.wrist(np.radians(25)) for _ in range(4)]
    recording = sim.record(wrists=[WORK_ROTATION] * 6 + tilts, plan=request.param)
    return sim, calibrate_system(recording)


def asked_after(sim, shift):
    sim.base_from_camera = Simulation.base_from_camera @ shift
    try:
        return sim.request()
    finally:
        sim.base_from_camera = Simulation.base_from_camera


def place(request, stability):
    return CameraPlace(stability, FlangeTag(request.seen.tag_a, request.seen.base_from_wrist))


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
@pytest.mark.parametrize("shift", [Pose.identity(), KNOCK, FAR], ids=["still", "knocked", "far"])
def test_every_plan_follows_a_camera_that_moved(taught, shift, stability) -> None:
    """Eq. 19 and Eq. 6 give the same coordinate wherever the camera stands: the true one."""
    sim, calibration = taught
    for policy in (Policy.FIXED, Policy.FOLLOW):
        request = asked_after(sim, shift)
        expected = expected_coordinate(
            calibration,
            request.target,
            request.seen.tag_b,
            policy,
            camera=place(request, stability),
        )
        tip = expected.base_from_wrist @ sim.tcp_in_wrist
        miss = tip - sim.point(request.target, request.angle_rad)
        assert np.linalg.norm(miss) < 5e-3, policy


def test_every_plan_refuses_a_movable_camera_without_tag_a(taught) -> None:
    sim, calibration = taught
    request = asked_after(sim, FAR)
    with pytest.raises(TagNotSeen, match="bring tag A into view"):
        expected_coordinate(
            calibration,
            request.target,
            request.seen.tag_b,
            Policy.FOLLOW,
            camera=CameraPlace(ANYWHERE),
        )


def test_every_plan_refuses_a_tag_b_that_slipped_and_names_it(taught) -> None:
    sim, calibration = taught
    request = asked_after(sim, Pose.identity())
    tag_b = request.seen.tag_b
    slip = Pose.from_rotvec((0.0, 0.0, 0.0), (8.0, 0.0, 0.0))
    slipped = replace(tag_b, camera_from_tag=tag_b.camera_from_tag @ slip)
    with pytest.raises(Contradiction, match="tag B sits elsewhere") as caught:
        expected_coordinate(
            calibration, request.target, slipped, Policy.FOLLOW, camera=place(request, FIXED)
        )
    assert "tag B" in caught.value.links
