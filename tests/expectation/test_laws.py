"""Laws of the expected error: what is better in the cell or in teaching is never worse in the answer.

Exact ones hold for what the estimate weighs. It does not weigh assumed errors of intrinsics and of time, so that these
are nought here.
"""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.simulation import Simulation
from vgrd.errors import InputError, NotObservable
from vgrd.model import Motion, Policy, Stability, frozen_array
from vgrd.solving.expectation import Assumptions, Cell, expect

FACTS = replace(Simulation(1).facts(), tag_a_sigma_mm=0.02, tag_b_sigma_mm=0.02)
STABILITY = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
MOVABLE = frozen_array([np.inf] * 6, 6)
WEIGHED = {"focal_percent": 0.0, "center_px": 0.0, "drift_mm": 0.0}
SAME = 1e-6  # rounding


def cell(motion=Motion.TURNTABLE, stability=Stability.FIXED, touch_mm=0.02, **given):
    """Touches so fine that everything else shows."""
    spec = replace(FACTS.object, motion=motion)
    facts = replace(FACTS, object=spec, camera_stability=stability, robot_sigma_mm=0.02)
    free = MOVABLE if stability is Stability.MOVABLE else STABILITY
    assumed = Assumptions.of(facts, WEIGHED | given)
    return Cell(facts, free, (touch_mm, touch_mm), Policy.FIXED, assumed)


def with_tags(one, a_mm, b_mm):
    facts = one.facts
    tags = {
        "tag_a": replace(facts.tag_a, size_mm=a_mm),
        "tag_b": replace(facts.tag_b, size_mm=b_mm),
    }
    return replace(one, facts=replace(facts, **tags))


def errors(one):
    """(turns, t) mm."""
    return np.array([budget.u95_mm for budget in expect(one).budgets])


@pytest.mark.parametrize(
    ("motion", "stability"),
    [
        (Motion.TURNTABLE, Stability.FIXED),
        (Motion.FREE, Stability.FIXED),
        (Motion.PLANAR, Stability.MOVABLE),
    ],
)
def test_a_larger_tag_is_never_worse(motion, stability):
    one = cell(motion, stability)
    sizes = ((15, 15), (30, 15), (15, 30), (30, 30))
    small, larger_a, larger_b, both = (errors(with_tags(one, *mm)) for mm in sizes)
    assert (larger_a <= small + SAME).all()
    assert (larger_b <= small + SAME).all()
    assert (both < small).all()


@pytest.mark.parametrize("motion", [Motion.TURNTABLE, Motion.FREE])
def test_more_samples_are_never_worse(motion):
    few = cell(motion)
    assumed, now = few.assumed, errors(few).max()
    for name in ("looks", "spins"):  # from other poses: not the same ones and more
        more = replace(assumed, **{name: 2 * getattr(assumed, name)})
        assert errors(replace(few, assumed=more)).max() <= 1.01 * now
    twice = {name: 2 * getattr(assumed, name) for name in ("touches", "turned", "tilted")}
    assert errors(replace(few, assumed=replace(assumed, **twice))).max() < now


@pytest.mark.parametrize("motion", Motion)
def test_noise_of_pixels_touches_and_arm_makes_it_worse(motion):
    fine = cell(motion)
    now = errors(fine)
    for worse in (
        replace(fine, assumed=replace(fine.assumed, corner_px=2 * fine.assumed.corner_px)),
        replace(fine, touch_sigmas_mm=(0.04, 0.04)),
        replace(fine, assumed=replace(fine.assumed, arm_mm=0.04)),
    ):
        assert (errors(worse) > now).all()


@pytest.mark.parametrize("motion", [Motion.TURNTABLE, Motion.FREE])
def test_a_camera_twice_as_far_is_worse(motion):
    assert (
        errors(cell(motion, distance_mm=1400.0)) > errors(cell(motion, distance_mm=700.0))
    ).all()


def test_a_hidden_tag_a_is_worse_than_one_in_view():
    one = cell()
    hidden = np.array([b.u95_mm for b in expect(one, tag_a_in_view=False).budgets])
    assert (hidden > errors(one)).all()


@pytest.mark.parametrize("motion", [Motion.PLANAR])
def test_shares_of_the_links_are_the_whole_variance(motion):
    budget = expect(cell(motion)).budget
    assert budget.shares.min() >= 0
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1.0)


def test_touches_alone_in_a_perfect_cell_are_the_error_of_a_mean():
    """One wrist, one place of the object: each answer errs as the rigid fit of CAD to touches does."""
    exact = replace(FACTS.object, cad_sigma_mm=0.0, center_sigma_mm=1e-4)
    facts = replace(
        FACTS, object=exact, tag_a_sigma_mm=0.0, tag_b_sigma_mm=0.0, robot_sigma_mm=1e-6
    )
    given = {"corner_px": 1e-4, "turned": 0, "tilted": 0, "touches": 6}
    assumed = Assumptions.of(facts, WEIGHED | given)
    one = Cell(facts, np.zeros(6), (0.1, 0.1), Policy.FIXED, assumed)
    told = expect(one).budgets[0]
    # Six touches of a circle's points: mean 1/6, turn about z 1/6 across, tilts 2/6 along: in all 1.
    variance = 0.1**2 * (2 / 6 + 1 / 6 + 1 / 6 + 2 / 6)
    assert told.u95_mm == pytest.approx(np.full(6, told.u95_mm[0]), rel=1e-3)
    assert 1.5 < (told.u95_mm[0] / np.sqrt(variance)) < 1.96


@pytest.mark.parametrize(
    ("motion", "stability", "given", "told"),
    [
        (Motion.FREE, Stability.FIXED, {"spins": 3}, "--spins"),
        (Motion.FREE, Stability.FIXED, {"turned": 3}, "--turned"),
        (Motion.TURNTABLE, Stability.MOVABLE, {"turned": 3}, "--turned"),
    ],
)
def test_samples_that_such_a_cell_has_not_are_refused(motion, stability, given, told):
    with pytest.raises(InputError, match=told):
        expect(cell(motion, stability, **given))


def test_too_few_touches_are_refused_with_what_is_missing():
    with pytest.raises(NotObservable, match="touch with the wrist tilted"):
        expect(cell(touches=2, turned=0, tilted=0))
