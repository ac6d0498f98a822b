"""The drawing of the cell shows what is told, where it is, and the words beside it lead to the goal."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from vgrd.geometry import Pose
from vgrd.page import texts
from vgrd.page.scene import drawing, move_in_words, project

NUMBER = r"(-?\d+(?:\.\d+)?)"
POINTS = arrays.arrays(float, (4, 3), elements=st.floats(-1000, 1000))
AZIMUTH = st.floats(0, 360)
STEP = {
    "kind": "touch",
    "flange_mm": [100.0, 50.0, 300.0],
    "rotvec_deg": [180.0, 0.0, 0.0],
    "target": "P1",
}


def rows(*place: float) -> list[list[float]]:
    return Pose.from_rotvec([np.pi, 0.0, 0.0], place).matrix().tolist()


def scene(**changes: Any) -> dict[str, Any]:
    told = {
        "known": "session",
        "flange": rows(0, 0, 400),
        "camera": rows(0, 0, 900),
        "tag_a": rows(30, 0, 380),
        "tag_b": rows(0, 200, 10),
        "axis": Pose.from_rotvec([0, 0, 0], [50, 200, 0]).matrix().tolist(),
        "tip_in_wrist": [0.0, 0.0, 120.0],
        "targets": {"P1": [50.0, 120.0, 0.0], "P2": [130.0, 200.0, 0.0]},
        "tag_mm": {"a": 30.0, "b": 40.0},
    }
    return told | changes


@given(POINTS, AZIMUTH)
def test_the_view_is_linear_and_keeps_heights_upright(points, azimuth):
    flat = project(points, azimuth)
    assert project(points[:2] + points[2:], azimuth) == pytest.approx(
        flat[:2] + flat[2:], abs=1e-6
    )
    raised = project(points + np.array([0, 0, 10.0]), azimuth)
    assert raised[:, 0] == pytest.approx(flat[:, 0])
    assert (raised[:, 1] > flat[:, 1]).all()


@given(POINTS, AZIMUTH, st.floats(-180, 180))
def test_turning_the_view_is_turning_the_cell_the_other_way(points, azimuth, turn):
    turned = points @ Pose.from_rotvec([0, 0, -np.radians(turn)]).rotation.T
    assert project(points, azimuth + turn) == pytest.approx(project(turned, azimuth), abs=1e-6)


def test_everything_that_is_told_is_drawn_and_named():
    shown = drawing(scene(), STEP, 45.0)
    for label in (texts.FLANGE, texts.CAMERA, "tag A", "tag B", "P1", "P2", texts.GOAL):
        assert f">{label}</text>" in shown
    assert 'marker-end="url(#head)"' in shown


@pytest.mark.parametrize(
    "missing", ["flange", "camera", "tag_a", "tag_b", "axis", "tip_in_wrist", "targets"]
)
def test_what_is_not_known_is_left_out_and_the_rest_drawn(missing):
    shown = drawing(scene(**{missing: None}), STEP, 45.0)
    assert shown.startswith("<svg")
    assert texts.GOAL in shown


def test_nothing_known_is_an_empty_drawing():
    assert drawing({}, {"kind": "wait"}, 0.0).startswith("<svg")
    assert move_in_words({}, STEP) == ""
    assert move_in_words(scene(), {"kind": "spin"}) == ""


@given(
    st.lists(st.tuples(*[st.floats(-2000, 2000)] * 3), min_size=1, max_size=6),
    AZIMUTH,
)
def test_nothing_is_drawn_outside(places, azimuth):
    targets = {f"P{i}": list(place) for i, place in enumerate(places)}
    shown = drawing(scene(targets=targets), STEP, azimuth)
    width, height = map(float, re.findall(r'viewBox="0 0 (\d+) (\d+)"', shown)[0])
    for x, y in re.findall(rf'cx="{NUMBER}" cy="{NUMBER}"', shown):
        assert 0 <= float(x) <= width
        assert 0 <= float(y) <= height


def test_a_name_of_a_target_is_text():
    shown = drawing(scene(targets={"<script>": [0.0, 0.0, 0.0]}), STEP, 0.0)
    assert "<script" not in shown


@given(
    st.tuples(*[st.floats(-900, 900)] * 3),
    st.tuples(*[st.floats(-1.7, 1.7)] * 3),
)
def test_who_moves_as_the_words_say_arrives(place, rotvec):
    now = Pose.from_rotvec(rotvec, place)
    words = move_in_words(scene(flange=now.matrix().tolist()), STEP)
    goal = Pose.from_rotvec(np.radians(STEP["rotvec_deg"]), STEP["flange_mm"])
    found = [float(one) for one in re.findall(NUMBER, words)]
    way, turn = found[:3], found[3:] or [0.0, 0.0, 0.0, 1.0]
    arrived = Pose.from_rotvec(np.radians(turn[0]) * np.array(turn[1:])).rotation @ now.rotation
    assert now.translation + way == pytest.approx(goal.translation, abs=0.51)
    assert Pose(arrived, np.zeros(3)).distance(Pose(goal.rotation, np.zeros(3)))[1] < np.radians(2)


def test_at_the_goal_it_says_so():
    goal = Pose.from_rotvec(np.radians(STEP["rotvec_deg"]), STEP["flange_mm"])
    assert move_in_words(scene(flange=goal.matrix().tolist()), STEP) == texts.REACHED


def test_spinning_shows_which_way_the_object_turns():
    assert texts.TURN in drawing(scene(), {"kind": "spin"}, 0.0)
