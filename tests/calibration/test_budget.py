from dataclasses import replace

import numpy as np
import pytest

from fakes.simulation import FINE, Simulation
from vgrd.calibration.budget import (
    ARM,
    INTRINSICS,
    PICTURE,
    PRINT_A,
    PRINT_B,
    TIME,
    UNKNOWN,
    Systematic,
    error_budget,
)
from vgrd.calibration.joint import ArmModel, calibrate_joint
from vgrd.calibration.joint_expected import expected_by_joint
from vgrd.calibration.joint_problem import Link
from vgrd.geometry import Pose
from vgrd.model import Policy


def taught(seed=1, *, arm=None, **options):
    sim = Simulation(seed, **options)
    wrists = [sim.wrist()] * 6 + [sim.wrist(0.4) for _ in range(4)]
    recording = sim.record(wrists=wrists)
    return sim, recording, calibrate_joint(recording, arm=arm or ArmModel())


def share(budget, link):
    return budget.shares[:, budget.links.index(link)]


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("arm", [ArmModel(), ArmModel(0.05), ArmModel(0.03, 0.15)])
def test_shares_sum_to_one_and_the_radius_is_that_of_the_answer(arm, policy):
    sim, _, result = taught(arm=arm)
    seen = sim.request().seen.tag_b
    budget = error_budget(result, seen, policy)
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1)
    assert (budget.shares >= -1e-12).all()
    radii = [expected_by_joint(result, name, seen, policy).u95_mm for name in budget.targets]
    np.testing.assert_allclose(budget.u95_mm, radii, rtol=1e-6)


def test_the_worst_link_has_the_largest_share():
    sim, _, result = taught(vision=FINE)
    assert (share(error_budget(result, sim.request().seen.tag_b), Link.TOUCHES) > 0.9).all()
    sim, _, result = taught(touch_sigma_mm=0.001)
    by_tags = error_budget(result, sim.request().seen.tag_b)
    assert (share(by_tags, Link.TOUCHES) < 0.05).all()
    sim, _, result = taught(touch_sigma_mm=0.01, vision=FINE, arm=ArmModel(0.2))
    assert (share(error_budget(result, sim.request().seen.tag_b), ARM) > 0.9).all()


def test_without_errors_of_the_arm_or_unknowns_their_shares_are_nought():
    sim, _, result = taught()
    budget = error_budget(result, sim.request().seen.tag_b)
    np.testing.assert_array_equal(share(budget, ARM), 0)
    np.testing.assert_array_equal(share(budget, UNKNOWN), 0)
    assert (share(budget, PICTURE) > 0).all()


def test_time_and_systematic_errors_count_once_they_are_given():
    sim, _, result = taught()
    seen = sim.request().seen.tag_b
    without = error_budget(result, seen)
    systematic = Systematic(np.diag([9.0, 9, 4, 4, 0, 0]), 0.05, 0.1)
    budget = error_budget(result, seen, systematic=systematic)
    assert not {INTRINSICS, PRINT_A, PRINT_B, TIME} & set(without.links)
    for link in (INTRINSICS, PRINT_A, PRINT_B, TIME):
        assert (share(budget, link) > 0).all()
    assert (budget.u95_mm > without.u95_mm).all()
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1)


def test_a_larger_tag_moves_the_answer_as_the_budget_says():
    sim, recording, result = taught(touch_sigma_mm=0.02)
    seen = sim.request().seen
    factor = 1.0001
    wrong = {
        "looks": tuple(nearer(seen, factor) for seen in recording.looks),
        "spins": tuple(nearer(seen, factor) for seen in recording.spins),
        "touches": tuple(
            replace(t, observation=nearer(t.observation, factor)) for t in recording.touches
        ),
    }
    other = calibrate_joint(replace(recording, **wrong), arm=ArmModel())
    moved = (
        expected_by_joint(other, "P3", seen).base_from_wrist.translation
        - expected_by_joint(result, "P3", seen).base_from_wrist.translation
    )
    sigma = 0.0001 * recording.facts.tag_a.size_mm
    budget = error_budget(result, seen.tag_b, systematic=Systematic(tag_size_sigma_mm=sigma))
    plain = error_budget(result, seen.tag_b)
    row = budget.targets.index("P3")
    total = np.trace(expected_by_joint(result, "P3", seen).position_covariance)
    with_print = total / (1 - share(budget, PRINT_B)[row] - share(budget, PRINT_A)[row])
    assert plain.u95_mm[row] < budget.u95_mm[row]
    assert share(budget, PRINT_A)[row] * with_print == pytest.approx(moved @ moved, rel=0.1)


def nearer(observation, factor):
    """The picture with tag A, printed larger by `factor`, taken for one of nominal size."""
    tag = observation.tag_a
    pose = Pose(tag.camera_from_tag.rotation, tag.camera_from_tag.translation / factor)
    return replace(observation, tag_a=replace(tag, camera_from_tag=pose))


def test_the_table_names_every_target_and_link():
    sim, _, result = taught()
    rows = error_budget(result, sim.request().seen.tag_b).rows()
    assert [row["target"] for row in rows] == [f"P{k}" for k in range(1, 7)]
    links = [value for key, value in rows[0].items() if key not in ("target", "u95_mm")]
    assert sum(links) == pytest.approx(1)
