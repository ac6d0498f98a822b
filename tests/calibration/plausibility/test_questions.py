"""A wrong touch is questioned when it is taken, by what is known then, and a right one is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.plausibility import InUse, misses, missing_tags, questions
from vgrd.calibration.plausibility.rigid import PlacedTouches, fit_rigidly
from vgrd.calibration.plausibility.stands import Stands, placed_in_one, tied_camera
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.touches import arm_touches, cad_touches
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import UNMOVED, Plan, Recording


def cell_of(seed: int) -> Simulation:
    cell = Simulation(seed)
    cell.put_uneven_part()
    return cell


def session(seed: int, spread_rad: float = 0.0, touches: int = 7, **options) -> Recording:
    cell = cell_of(seed)
    return cell.record(
        looks=options.pop("looks", 0),
        spins=0,
        wrists=[cell.wrist(spread_rad) for _ in range(touches)],
        **options,
    )


def named(recording: Recording, **names: str) -> Recording:
    """With other names for touches: t3="P5" for the third of them."""
    touches = list(recording.touches)
    for key, name in names.items():
        index = int(key[1:]) - 1
        touches[index] = replace(touches[index], target=name)
    return replace(recording, touches=tuple(touches))


def moved(recording: Recording, index: int, shift_mm, R=None) -> Recording:
    touches = list(recording.touches)
    pose = touches[index].base_from_wrist
    turned = pose.rotation if R is None else R
    touches[index] = replace(
        touches[index], base_from_wrist=Pose(turned, pose.translation + np.array(shift_mm))
    )
    return replace(recording, touches=tuple(touches))


def first(recording: Recording, count: int) -> Recording:
    return replace(recording, touches=recording.touches[:count])


def asked(recording: Recording, *in_use: InUse) -> dict[int, str]:
    """Samples are numbered from 11 on."""
    return questions(recording, range(11, 11 + len(recording.touches)), *in_use)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.3]), st.integers(1, 9))
def test_the_cost_of_right_touches_is_chance_for_its_freedom(seed, spread_rad, count):
    """A law of the fit: of unit variance for each degree of freedom, which touches alone bring about."""
    recording = session(seed, spread_rad, count)
    _, points = cad_touches(recording)
    fit = fit_rigidly(PlacedTouches(points, arm_touches(recording.touches, recording)))
    most = {1: 0, 2: 1}.get(count, 3 * count - 6)  # two touches tell their distance
    assert -1e-6 <= fit.freedom <= most + 1e-6
    assert fit.cost <= fit.freedom + 8 * np.sqrt(2 * fit.freedom) + 3


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(*[st.floats(-500, 500)] * 3),
)
def test_nothing_depends_on_where_the_base_is(seed, turn, shift):
    recording = named(session(seed, 0.3, 6), t5="P1")
    frame = Pose(exp_rotation(turn), np.array(shift))
    elsewhere = replace(
        recording,
        touches=tuple(
            replace(touch, base_from_wrist=frame @ touch.base_from_wrist)
            for touch in recording.touches
        ),
    )
    assert asked(elsewhere).keys() == asked(recording).keys() == {15}


@pytest.mark.parametrize("spread_rad", [0.0, 0.3])
def test_right_touches_are_not_questioned_and_a_wrong_name_is_with_the_right_one(spread_rad):
    recording = session(3, spread_rad)
    assert asked(recording) == {}
    told = asked(first(named(recording, t5="P3"), 5))
    assert told.keys() == {15}
    assert "the touches so far put the tip" in told[15]
    assert "mm from P3, nearest target P5 (" in told[15]
    assert told[15].endswith("vgrd undo 15, or vgrd retag 15 P5")


def test_a_tip_in_the_air_has_no_other_name():
    told = asked(moved(session(4), 6, (0, 0, 30.0)))
    assert told == {17: told[17]}
    assert "puts" not in told[17]
    assert "mm from P1, no target is nearer: vgrd undo 17, and touch P1 again" in told[17]


def test_two_touches_of_one_wrist_tell_already_that_they_are_not_as_far_apart_as_cad_says():
    recording = first(session(5), 2)
    assert asked(recording) == {}
    told = asked(moved(recording, 1, (5.0, -5.0, 0.0)))
    assert told.keys() == {12}
    assert "vgrd undo 11" in told[12]
    assert "vgrd undo 12" in told[12]


def test_names_exchanged_from_the_first_touch_on_are_found_by_the_third():
    exchanged = named(session(6), t1="P2", t2="P1")
    assert asked(first(exchanged, 2)) == {}
    told = asked(first(exchanged, 3))
    assert told.keys() == {11, 12}
    assert "vgrd retag 11 P1, vgrd retag 12 P2" in told[11]


def test_a_first_touch_in_the_air_does_not_discredit_those_after_it():
    told = asked(moved(session(7), 0, (0, 20.0, 40.0)))
    assert told.keys() == {11}
    assert "mm from P1" in told[11]


def test_the_first_touch_of_a_turned_table_is_foretold_by_the_centre_that_stays():
    """One wrist tells nothing of the TCP, and a turned touch of any hole of one height would fit some TCP."""
    names = ["P1", "P3", "P4", "P5", "P6", "P2"]
    recording = session(8, looks=8, touches=6, names=names, turns_rad=[0.0] * 5 + [2.0])
    wrong = named(recording, t6="P5")
    assert asked(recording) == {}
    assert asked(wrong).keys() == {16}
    assert "nearest target P2" in asked(wrong)[16]
    part = replace(recording.facts.object, center_in_object=None)
    assert asked(replace(wrong, facts=replace(wrong.facts, object=part))) == {}


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.tuples(st.floats(3, 40), st.floats(-40, 40)))
@example(2189, (8.0, 0.0))  # would be questioned if every small turn told a centre
def test_a_part_that_was_pushed_instead_of_turned_is_followed_too(seed, push_mm):
    cell, push = cell_of(seed), Pose(np.eye(3), np.array([*push_mm, 0.0]))
    recording = cell.record(looks=8, spins=0, wrists=[cell.wrist(0.0) for _ in range(7)])
    in_camera = cell.base_from_camera.inverse() @ push @ cell.base_from_camera
    touches = list(recording.touches)
    for index in (4, 5, 6):
        touch, tag = touches[index], touches[index].observation.tag_b
        seen = replace(tag, camera_from_tag=in_camera @ tag.camera_from_tag)
        touches[index] = replace(
            touch,
            base_from_wrist=push @ touch.base_from_wrist,
            observation=replace(touch.observation, tag_b=seen),
        )
    pushed = replace(recording, touches=tuple(touches))
    assert Stands.of_touches(pushed).of == (0, 0, 0, 0, 1, 1, 1)
    assert asked(pushed) == {}
    assert 17 in asked(named(pushed, t7="P5"))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.15, 3.1), st.integers(1, 4))
def test_the_cost_beside_a_centre_that_stays_is_chance_for_its_freedom(seed, turn, turned):
    turns = [0.0] * 4 + [turn] * turned
    recording = session(seed, looks=8, touches=len(turns), turns_rad=turns)
    stands, tied = Stands.of_touches(recording), tied_camera(recording)
    placed = placed_in_one(recording, range(len(turns)), stands, tied)
    assert len(placed.still.points) == 1
    fit = fit_rigidly(placed)
    assert (
        3 * len(turns) - 6 - 1e-6 <= fit.freedom <= 3 * len(turns) - 5
    )  # the centre tells the tip across
    assert fit.cost <= fit.freedom + 8 * np.sqrt(2 * fit.freedom) + 3


def test_a_turned_table_is_followed_by_tag_b_once_the_looks_tie_the_camera_to_the_robot():
    turns = [0.0, 2.0, 0.0, 4.0, 0.0, 2.0, 4.0]
    recording = session(8, looks=6, turns_rad=turns)
    assert asked(recording) == {}
    assert 17 in asked(named(recording, t7="P4"))
    alone = replace(recording, looks=(), touches=recording.touches[3:4] + recording.touches[6:])
    assert (
        asked(moved(alone, 1, (0, 0, 1.0))) == {}
    )  # two touches of two stands, no camera: nothing


def test_touches_of_bare_targets_and_without_tag_b_say_nothing_of_places():
    recording = named(session(9), t5="P3")
    hidden = list(recording.touches)
    hidden[4] = replace(hidden[4], observation=replace(hidden[4].observation, tag_b=None))
    told = asked(replace(recording, touches=tuple(hidden)))
    assert told.keys() == {15}
    assert "tag B is not in the picture" in told[15]
    assert "mm from" not in told[15]


def test_the_tag_that_is_missing_is_told():
    recording = session(9, touches=1)
    seen = recording.touches[0].observation
    assert missing_tags(recording.facts, seen) == ""
    assert missing_tags(recording.facts, replace(seen, tag_a=None)).startswith(
        "tag A is not in the picture: turn it to the camera; the touch counts, its look does not"
    )
    assert missing_tags(replace(recording.facts, tag_a=None), replace(seen, tag_a=None)) == ""


def test_a_wrist_that_no_other_touch_has_is_questioned():
    recording = session(10)
    flipped = recording.touches[3].base_from_wrist.rotation @ exp_rotation((2.0, 0, 0))
    told = asked(moved(recording, 3, (0, 0, 0), flipped))
    assert "the tool leans 115 degrees away from every other touch" in told[14]
    assert "vgrd undo 14" in told[14]
    turned = recording.touches[3].base_from_wrist.rotation @ exp_rotation((0, 0, np.radians(5)))
    special = replace(moved(recording, 3, (0, 0, 0), turned), plan=Plan.SPECIAL)
    assert "plan special wants one wrist" in asked(special)[14]
    assert "turned by 5.0 degrees" in asked(special)[14]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    cell = cell_of(20)
    wrists = [WORK_ROTATION] * 6 + [cell.wrist(0.4) for _ in range(6)]
    return calibrate_system(cell.record(looks=8, spins=6, wrists=wrists))


def in_use(calibration: Calibration, recording: Recording) -> InUse:
    return InUse(lambda i: misses(calibration, recording.touches[i], UNMOVED, recording.facts))


def test_the_calibration_in_use_questions_the_first_touch(calibration):
    right = first(session(21, turns_rad=[1.0] * 7), 1)
    assert asked(right, in_use(calibration, right)) == {}
    wrong = named(right, t1="P3")
    told = asked(wrong, in_use(calibration, wrong))
    assert told[11].startswith("the calibration puts the tip ")
    assert told[11].endswith("vgrd undo 11, or vgrd retag 11 P1")


def test_touches_that_miss_alike_speak_against_the_calibration_and_not_against_themselves(
    calibration,
):
    """As after another tool was mounted: the second one is not asked about, and the session goes on."""
    recording = session(22)
    for index in range(7):
        recording = moved(recording, index, (0, 0, 9.0))
    told = asked(recording, in_use(calibration, recording))
    assert set(told) <= {11}
