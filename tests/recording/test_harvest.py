"""Which rests become samples: those that add something, once each, and nothing that moves."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import FINE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.harvest import Harvest, HarvestKind
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import Motion, Stability

LOOK, SPIN = HarvestKind.LOOK, HarvestKind.SPIN
CELL = Simulation(3, vision=FINE)
EDGE = np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])


def aside(x_mm=0.0, turn_rad=0.0):
    """A place of the flange beside the object."""
    turn = exp_rotation((turn_rad, 0.0, 0.0))
    return Pose(WORK_ROTATION @ turn, np.array([300.0 + x_mm, 60, 300]))


def pictures(pose, angles, *, tags="ab", since_s=None):
    """One rest of the arm: a picture for each angle of the table, with corners of the tags."""
    seen = [CELL.observe(pose, angle) for angle in angles]
    since_s = seen[0].stamp_s if since_s is None else since_s
    return [
        replace(
            one,
            rest_since_s=since_s,
            tag_a=with_corners(one.tag_a) if "a" in tags else None,
            tag_b=with_corners(one.tag_b) if "b" in tags else None,
        )
        for one in seen
    ]


def with_corners(tag):
    points = tag.camera_from_tag @ (0.5 * tag.tag.size_mm * EDGE)
    return replace(tag, corners_px=6486.0 * points[:, :2] / points[:, 2:])


def harvested(harvest, seen):
    """Kinds of what becomes of these pictures, in their order."""
    samples = [harvest.consider(one) for one in seen]
    return [sample.kind for sample in samples if sample is not None]


@pytest.fixture
def harvest():
    return Harvest(CELL.facts())


def test_the_first_rest_is_a_look_and_each_turn_of_the_table_a_spin(harvest):
    assert harvested(harvest, pictures(aside(), [0.0, 0.0])) == [LOOK]
    for angle in (0.5, 1.0, 1.5):
        assert harvested(harvest, pictures(aside(), [angle, angle])) == [SPIN]
    assert harvested(harvest, pictures(aside(), [0.5, 0.5])) == []
    assert harvested(harvest, pictures(aside(), [0.0, 0.0])) == []
    assert harvested(harvest, pictures(aside(100.0), [0.0, 0.0])) == [LOOK]


def test_one_rest_of_the_arm_gives_many_spins_and_one_picture_is_not_enough(harvest):
    angles = [0.0, 0.0, 0.0, 0.6, 0.6, 0.6, 1.2, 1.8, 1.8]
    assert harvested(harvest, pictures(aside(), angles)) == [LOOK, SPIN, SPIN]


def test_the_same_place_is_not_taken_twice_and_another_one_is(harvest):
    assert harvested(harvest, pictures(aside(), [0.0, 0.0])) == [LOOK]
    assert harvested(harvest, pictures(aside(20.0), [0.0, 0.0])) == []
    assert harvested(harvest, pictures(aside(20.0, np.radians(10)), [0.0, 0.0])) == [LOOK]


@pytest.mark.parametrize(
    ("tags", "kinds"), [("a", [LOOK]), ("b", [SPIN]), ("ab", [LOOK]), ("", [])]
)
def test_what_is_seen_decides(harvest, tags, kinds):
    assert harvested(harvest, pictures(aside(), [0.0, 0.0], tags=tags)) == kinds


def test_a_table_that_turns_while_the_arm_rests_gives_no_sample(harvest):
    harvested(harvest, pictures(aside(), [0.0, 0.0]))
    assert harvested(harvest, pictures(aside(), np.arange(0.4, 1.2, 0.1))) == []


def test_a_creeping_table_gives_no_sample_before_it_stands(harvest):
    slow = np.arange(
        0.0, 0.03, 1e-3
    )  # 1 mrad from picture to picture: half a pixel at a tag's corner
    assert harvested(harvest, pictures(aside(), slow)) == []
    assert harvested(harvest, pictures(aside(), [0.03, 0.03])) == [LOOK]


def test_an_arm_that_creeps_or_is_leaned_on_gives_no_sample(harvest):
    creeping = [pictures(aside(0.1 * k), [0.0])[0] for k in range(20)]
    assert harvested(harvest, creeping) == []  # each is a rest of its own
    since_s = creeping[-1].rest_since_s + 1.0
    # Encoders that see nothing of it: the arm bends by a quarter of a millimetre and more.
    bent = [pictures(aside(0.25 * k), [0.0], since_s=since_s)[0] for k in range(1, 9)]
    leaned = [replace(one, base_from_wrist=bent[0].base_from_wrist) for one in bent]
    assert harvested(harvest, leaned) == []


def test_a_rest_whose_beginning_is_not_known_is_none(harvest):
    seen = [replace(one, rest_since_s=None) for one in pictures(aside(), [0.0, 0.0])]
    assert harvested(harvest, seen) == []


def test_a_sample_that_is_asked_for_replaces_the_harvested_one_of_its_rest(harvest):
    first, second, third = pictures(aside(), [0.0] * 3)
    assert harvested(harvest, [first, second]) == [LOOK]
    assert harvest.note(third) == (second,)
    assert harvested(harvest, pictures(aside(), [0.0] * 3, since_s=first.rest_since_s)) == []
    turned = pictures(aside(), [1.0, 1.0], since_s=first.rest_since_s)
    assert harvested(harvest, turned) == [SPIN]
    assert harvest.note(pictures(aside(), [0.0], since_s=first.rest_since_s)[0]) == ()


def test_what_was_undone_is_not_harvested_again_before_something_moved(harvest):
    seen = pictures(aside(), [0.0] * 4)
    assert harvested(harvest, seen[:2]) == [LOOK]
    harvest.refuse(seen[1])
    assert harvested(harvest, seen[2:]) == []
    assert harvested(harvest, pictures(aside(), [0.0, 0.0])) == [LOOK]


def test_too_many_looks_are_thinned_and_stay_spread():
    harvest, kept = Harvest(CELL.facts(), most=8), []
    for x_mm in np.linspace(0, 1400, 41):
        for seen in pictures(aside(float(x_mm)), [0.0, 0.0]):
            sample = harvest.consider(seen)
            if sample is not None:
                kept.append(seen)
                kept = [one for one in kept if not any(one is g for g in sample.given_back)]
    places = np.array([one.base_from_wrist.translation[0] for one in kept])
    assert 4 <= len(kept) <= 8
    assert np.diff(places).min() > 30
    assert places[0] == 300
    assert places[-1] > 1300


def test_too_many_spins_are_thinned_too():
    harvest, count = Harvest(CELL.facts(), most=6), 0
    for angle in np.linspace(0, 1.9 * np.pi, 30):
        for seen in pictures(aside(), [angle, angle]):
            sample = harvest.consider(seen)
            if sample is not None and sample.kind is SPIN:
                count += 1 - len(sample.given_back)
    assert 3 <= count <= 6


def test_an_object_that_moves_anyhow_gives_looks_only():
    facts = CELL.facts()
    harvest = Harvest(replace(facts, object=replace(facts.object, motion=Motion.FREE)))
    assert harvested(harvest, pictures(aside(), [0.0, 0.0, 1.0, 1.0])) == [LOOK]


def test_a_movable_camera_gives_spins_that_show_both_tags():
    harvest = Harvest(replace(CELL.facts(), camera_stability=Stability.MOVABLE))
    assert harvested(harvest, pictures(aside(), [0.0, 0.0], tags="a")) == []
    assert harvested(harvest, pictures(aside(), [0.0, 0.0], tags="b")) == []
    assert harvested(harvest, pictures(aside(), [0.0, 0.0, 1.0, 1.0])) == [SPIN, SPIN]
    assert harvested(harvest, pictures(aside(), [1.0, 1.0])) == []
    assert harvested(harvest, pictures(aside(100.0), [1.0, 1.0])) == [SPIN]
