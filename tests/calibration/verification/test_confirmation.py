"""What verifications confirm holds as often as it says, and nothing that is off is called good."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.confirmation import Confirmation, Verified, confirm, confirmed_mm
from vgrd.calibration.solve import calibrate_system
from vgrd.geometry import Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.model import Plan, Recording

TURNED = (1.2, 2.8)  # of the object, rad: more than 60 degrees from each other and from 0


@pytest.mark.parametrize("count", [2, 5, 12])
def test_the_confirmed_radius_holds_95_percent_in_95_percent_of_the_trials(count):
    draw = np.random.default_rng(5)
    sigma = 0.3
    misses = np.linalg.norm(draw.normal(0, sigma, (4000, count, 3)), axis=2)
    true_radius = sigma * np.sqrt(chi2_quantile(0.95, 3))
    told = [confirmed_mm([(one, 3) for one in trial]) for trial in misses]
    held = np.mean([one is not None and one >= true_radius for one in told])
    assert held == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 4000))


@given(st.lists(st.floats(0.01, 5), min_size=2, max_size=8), st.floats(0.1, 10))
def test_it_scales_with_the_misses_and_grows_with_each(lengths, scale):
    told = confirmed_mm([(one, 3) for one in lengths])
    scaled = confirmed_mm([(scale * one, 3) for one in lengths])
    worse = confirmed_mm([(lengths[0] + 0.1, 3), *[(one, 3) for one in lengths[1:]]])
    assert scaled == pytest.approx(scale * told)
    assert worse > told
    assert told > max(lengths) / np.sqrt(len(lengths))


def test_one_verification_confirms_nothing():
    assert confirmed_mm([(0.1, 3)]) is None
    assert confirmed_mm([]) is None


def told(misses, tolerance_mm=1.0, **changes):
    one = Verified("P1", None, 3, counts=True, fails=False)
    verified = tuple(replace(one, off_mm=miss, **changes) for miss in misses)
    return Confirmation(verified, tolerance_mm)


def test_two_that_count_and_fit_are_go_and_fewer_are_open():
    assert told([0.2, 0.3]).verdict == "go"
    assert told([0.2]).verdict == "open"
    assert told([]).verdict == "open"
    assert told([0.2, 0.3, 0.1], counts=False).verdict == "open"
    assert "60 degrees" in told([0.2]).sentence


def test_one_beyond_the_tolerance_or_beyond_chance_is_no_go_among_any_number_of_good_ones():
    assert told([0.2, 0.1, 1.01]).verdict == "no go"
    assert told([0.2, 0.1, 1.01], tolerance_mm=None).verdict == "go"
    assert told([0.2, 0.1], fails=True).verdict == "no go"
    assert "P1 1.01 mm" in told([0.2, 1.01]).sentence


def test_a_miss_at_the_taught_turn_that_chance_does_not_explain_is_no_go_too():
    assert told([0.2], counts=False, fails=True).verdict == "no go"


@pytest.mark.parametrize("miss", [0.27, 0.3, 0.4])
def test_so_many_more_as_are_told_confirm_the_tolerance_and_one_less_does_not(miss):
    said = told([miss, miss], tolerance_mm=0.8).sentence
    further = int(said.rpartition("; ")[2].split()[0])
    assert confirmed_mm([(miss, 3)] * (2 + further)) <= 0.8
    assert confirmed_mm([(miss, 3)] * (1 + further)) > 0.8


def test_misses_as_large_as_the_tolerance_never_confirm_it():
    assert "no number of them" in told([0.9, 0.9]).sentence


@pytest.fixture(scope="module")
def taught() -> tuple[Simulation, Recording]:
    sim = Simulation(3)
    wrists = [WORK_ROTATION] * 3 + [sim.wrist(np.radians(25)) for _ in range(3)]
    return sim, sim.record(wrists=wrists, plan=Plan.JOINT, looks=0, spins=4, points=0)


def confirmation(taught, *touches):
    _, recording = taught
    recording = replace(recording, verifications=touches)
    return confirm(calibrate_system(recording), recording, 2.0, None)


def test_honest_verifications_of_a_simulated_cell_are_go(taught):
    sim, _ = taught
    said = confirmation(taught, *(sim.touch("P2", WORK_ROTATION, angle) for angle in TURNED))
    assert said.verdict == "go"
    assert [one.counts for one in said.verified] == [True, True]
    assert said.confirmed_mm > max(one.off_mm for one in said.verified)


def test_a_verification_at_the_taught_turn_does_not_count(taught):
    sim, _ = taught
    said = confirmation(taught, *(sim.touch("P2", WORK_ROTATION, a) for a in (0.0, TURNED[0])))
    assert [one.counts for one in said.verified] == [False, True]
    assert said.verdict == "open"


def test_a_touch_8_mm_beside_is_no_go(taught):
    sim, _ = taught
    good, bad = (sim.touch("P2", WORK_ROTATION, angle) for angle in TURNED)
    pose = bad.base_from_wrist
    bad = replace(
        bad, base_from_wrist=Pose(pose.rotation, pose.translation + np.array([8.0, 0.0, 0.0]))
    )
    said = confirmation(taught, good, bad)
    assert said.verdict == "no go"
    assert said.verified[1].fails
    assert said.verified[1].off_mm == pytest.approx(8.0, abs=1.5)


def test_a_verification_without_tag_b_says_why_it_says_nothing(taught):
    sim, _ = taught
    touch = sim.touch("P2", WORK_ROTATION, TURNED[0])
    blind = replace(touch, observation=replace(touch.observation, tag_b=None))
    (one,) = confirmation(taught, blind).verified
    assert one.off_mm is None
    assert not one.counts
    assert "tag B was not in view" in one.trouble
