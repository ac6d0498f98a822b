"""A rotation vector is written near the taught one: noise flips no sign where a wrist stands by half a turn."""

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.geometry.rotation_formats import rotvec_near, usual_rotvec

NUMBERS = st.floats(-1.0, 1.0)
HALF_TURN = np.pi


@st.composite
def directions(draw: st.DrawFn) -> Array:
    vector = np.array([draw(NUMBERS) for _ in range(3)])
    length = float(np.linalg.norm(vector))
    assume(length > 0.1)
    return vector / length


@st.composite
def half_turns(draw: st.DrawFn) -> Array:
    """Rotation vectors within 0.02 rad of half a turn, on either side."""
    return (HALF_TURN + draw(st.floats(-0.02, 0.02))) * draw(directions())


ANY = st.builds(
    lambda axis, angle: axis * angle, directions(), st.floats(0.0, HALF_TURN) | st.just(0.0)
)


def rad_between(a: Array, b: Array) -> float:
    zero = np.zeros(3)
    return Pose(a, zero).distance(Pose(b, zero))[1]


@given(ANY, ANY | half_turns())
def test_it_means_the_same_orientation(rotvec: Array, near: Array) -> None:
    R = exp_rotation(rotvec)
    assert rad_between(exp_rotation(rotvec_near(R, near)), R) < 1e-7


@given(ANY, ANY | half_turns(), st.integers(-2, 2))
def test_no_other_vector_of_the_orientation_is_nearer(
    rotvec: Array, near: Array, turns: int
) -> None:
    chosen = rotvec_near(exp_rotation(rotvec), near)
    angle = float(np.linalg.norm(chosen))
    assume(angle > 1e-6)
    other = chosen * (1 + turns * 2 * np.pi / angle)
    assert np.linalg.norm(chosen - near) <= np.linalg.norm(other - near) + 1e-9


@given(half_turns(), directions(), st.floats(0.0, 0.3))
@example(np.array([HALF_TURN, 0, 0]), np.array([1.0, 0, 0]), 1e-9)
@example(np.array([HALF_TURN, 0, 0]), np.array([0.0, 1, 0]), 1e-9)
@example(np.array([-HALF_TURN, 0, 0]), np.array([0.0, 0, 1]), 0.1)
def test_a_wrist_near_the_taught_one_has_a_vector_near_it(
    taught: Array, lean: Array, rad: float
) -> None:
    """About an axis across the taught one a vector turns by half the lean and grows by what the lean bends it."""
    near = rotvec_near(exp_rotation(taught), taught)
    now = rotvec_near(exp_rotation(rad * lean) @ exp_rotation(taught), near)
    assert np.linalg.norm(now - near) <= 1.7 * rad + 1e-6  # half pi per rad across, 1 along


@given(ANY)
def test_away_from_half_a_turn_it_is_the_shortest(rotvec: Array) -> None:
    angle = float(np.linalg.norm(rotvec))
    assume(angle < 0.5 * HALF_TURN)
    R = exp_rotation(rotvec)
    assert np.allclose(rotvec_near(R, rotvec), rotvec, atol=1e-7)
    assert np.allclose(usual_rotvec(R), rotvec, atol=1e-7)


@pytest.mark.parametrize("yaw_deg", [0, 30, 90, -90, -120, 120])
def test_wrists_that_differ_by_noise_are_on_one_side(yaw_deg: float) -> None:
    """A tool that points down, at any turn about itself that people use."""
    rng = np.random.default_rng(1)
    down = exp_rotation((0, 0, np.radians(yaw_deg))) @ np.diag([1.0, -1.0, -1.0])
    vectors = [usual_rotvec(exp_rotation(rng.normal(0, 1e-4, 3)) @ down) for _ in range(50)]
    assert np.ptp(vectors, axis=0).max() < 0.01
    assert np.linalg.norm(vectors[0]) == pytest.approx(HALF_TURN, abs=1e-3)


def test_a_wrist_that_follows_a_whole_turn_flips_only_half_a_turn_away() -> None:
    down = np.diag([1.0, -1.0, -1.0])
    near = usual_rotvec(down)
    angles = np.radians(np.arange(-179, 180))
    vectors = [rotvec_near(exp_rotation((0, 0, a)) @ down, near) for a in angles]
    assert np.linalg.norm(np.diff(vectors, axis=0), axis=1).max() < 0.03  # of a degree: 0.027


def test_nothing_turned_is_nothing() -> None:
    assert not rotvec_near(np.eye(3), (HALF_TURN, 0, 0)).any()
