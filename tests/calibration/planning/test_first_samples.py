"""The first samples of a plan are told in its order, and looks that obey the words serve the hand-eye."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.first_samples import first_sample, wanted
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.geometry import Pose, exp_rotation, log_rotation
from vgrd.model import Plan, Stability

WORDS = re.compile(r"look (\d+) of 8: turn the wrist by (-?\d+) degrees about base ([XYZ]) ")


def obeyed(recording, cell):
    """The recording with the look that the words ask for, taken from where the last one was."""
    number, degrees, axis = WORDS.match(first_sample(recording)).groups()
    assert int(number) == len(recording.looks) + 1
    last = recording.looks[-1].base_from_wrist
    turn = exp_rotation(np.radians(float(degrees)) * np.eye(3)["XYZ".index(axis)])
    look = cell.observe(
        Pose(turn @ last.rotation, last.translation + np.array([0.0, 5.0, 0.0])), 0.0
    )
    return replace(recording, looks=(*recording.looks, look))


def test_looks_that_obey_turn_about_two_axes_by_the_third_and_stay_in_view():
    cell = Simulation(1)
    recording = cell.record(looks=0, spins=0, wrists=[])
    assert first_sample(recording).startswith("look 1 of 8: turn tag A to the camera")
    recording = replace(recording, looks=(cell.observe(cell.standing, 0.0),))
    for count in range(2, 9):
        recording = obeyed(recording, cell)
        rotations = [look.base_from_wrist.rotation for look in recording.looks]
        assert (turned_axes(rotations)[0] is Axes.MANY) == (count >= 3)
        assert np.linalg.norm(log_rotation(rotations[-1] @ rotations[0].T)) < np.radians(51)
    assert first_sample(recording).startswith("spin 1 of 4: turn the object")


def test_an_arm_that_only_yawed_is_asked_to_yaw():
    cell = Simulation(2, one_axis=True)
    recording = cell.record(looks=5, spins=0, wrists=[])
    assert WORDS.match(first_sample(recording))[3] == "Z"


def test_the_same_place_again_is_no_other_look():
    cell = Simulation(3)
    recording = cell.record(looks=2, spins=0, wrists=[])
    again = replace(recording, looks=(*recording.looks, recording.looks[1]))
    assert first_sample(again) == first_sample(recording)


@pytest.mark.parametrize("plan", list(Plan))
def test_a_session_that_has_what_its_plan_asks_for_wants_nothing(plan):
    cell = Simulation(4)
    recording = cell.record(
        looks=8, spins=4, wrists=[WORK_ROTATION] * 8, points=16, plan=Plan.CONVENTIONAL
    )
    assert first_sample(replace(recording, plan=plan)) == ""
    lacking = replace(recording, plan=plan, touches=recording.touches[:2])
    assert first_sample(lacking).startswith("touch 3 of ")


def test_a_movable_camera_wants_no_looks():
    facts = replace(Simulation(1).facts(), camera_stability=Stability.MOVABLE)
    assert wanted(Plan.JOINT, facts) == {"spin": 4, "touch": 8}
