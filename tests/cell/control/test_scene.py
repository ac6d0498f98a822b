"""Operation `scene`: what stands in the base is where the simulated cell has it, or is not told."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.scenery import scenery
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.control.scene import Scene
from vgrd.geometry import Pose
from vgrd.model import Plan

TILTED = [WORK_ROTATION] * 3
ANGLE = 1.1  # of the object now, rad


@pytest.fixture(scope="module")
def taught() -> tuple[Simulation, Any]:
    sim = Simulation(3, touch_sigma_mm=0.02)
    wrists = TILTED + [sim.wrist(np.radians(25)) for _ in range(3)]
    return sim, calibrate_system(sim.record(wrists=wrists, plan=Plan.JOINT, looks=0, spins=4))


def tell(sim: Simulation, calibration: Any, places: Any, *, tag_b: bool = True) -> dict[str, Any]:
    touch = sim.touch("P2", WORK_ROTATION, ANGLE)
    seen = touch.observation
    assert seen is not None
    sight = SimpleNamespace(tag_a=seen.tag_a, tag_b=seen.tag_b if tag_b else None)
    facts = sim.record(plan=Plan.JOINT).facts
    measuring = SimpleNamespace(
        reading=lambda: SimpleNamespace(base_from_wrist=touch.base_from_wrist),
        sight=sight,
        sight_of_object=sight if tag_b else None,
        facts=facts,
    )
    wizard, serving = SimpleNamespace(scenery=places), SimpleNamespace(calibration=calibration)
    scene: Any = Scene(measuring, serving, wizard)  # type: ignore[arg-type]
    return dict(asyncio.run(scene.table()["scene"].perform({})))


def test_the_touched_target_is_where_the_tip_is(taught):
    sim, calibration = taught
    for told in (tell(sim, calibration, {}), tell(sim, None, scenery(calibration.solution))):
        flange, tip = Pose.from_matrix(told["flange"]), told["tip_in_wrist"]
        assert told["targets"]["P2"] == pytest.approx(flange @ np.array(tip), abs=0.5)
        assert set(told["tag_mm"]) == {"a", "b"}


def test_tag_a_is_where_the_flange_carries_it(taught):
    sim, calibration = taught
    told = tell(sim, calibration, {})
    carried = Pose.from_matrix(told["flange"]) @ calibration.wrist_from_tag_a
    mm, rad = carried.distance(Pose.from_matrix(told["tag_a"]))
    assert mm < 0.5
    assert rad < 0.01


def test_without_an_estimate_only_the_flange_is_told(taught):
    sim, _ = taught
    told = tell(sim, None, {})
    assert told["known"] == ""
    assert told["flange"] is not None
    assert "camera" not in told


def test_without_tag_b_no_target_is_told(taught):
    sim, calibration = taught
    told = tell(sim, calibration, {}, tag_b=False)
    assert told["tag_b"] is None
    assert told["targets"] == {}
    assert told["camera"] is not None


def test_a_camera_whose_place_is_open_is_not_drawn(taught):
    _, calibration = taught
    solution = calibration.solution
    open_along = np.zeros((len(solution.covariance), 1))
    open_along[0] = 500.0
    assert scenery(replace(solution, undetermined=open_along)) is None
