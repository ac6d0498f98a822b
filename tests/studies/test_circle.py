import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fakes.studies.circle import smallest_circle
from vgrd.errors import InputError

coordinates = st.floats(-1000, 1000)
clouds = arrays(np.float64, st.tuples(st.integers(1, 8), st.just(2)), elements=coordinates)


def near(size):
    return 1e-9 * max(1.0, size)


@given(clouds)
def test_it_holds_all_points_and_two_lie_on_its_edge(points):
    circle = smallest_circle(points)
    distances = np.sort(np.linalg.norm(points - circle.center, axis=1))
    assert distances[-1] <= circle.diameter / 2 + near(circle.diameter)
    if circle.diameter > 1e-3:
        assert distances[-2] == pytest.approx(circle.diameter / 2, rel=1e-6)


@given(clouds)
def test_it_is_no_smaller_than_the_farthest_pair_and_no_larger_than_jung_allows(points):
    farthest = np.linalg.norm(points[:, None] - points, axis=2).max()
    diameter = smallest_circle(points).diameter
    assert farthest - near(farthest) <= diameter <= 2 / np.sqrt(3) * farthest + near(farthest)


@given(clouds, arrays(np.float64, (40, 2), elements=coordinates))
def test_no_other_centre_does_with_less(points, centers):
    circle = smallest_circle(points)
    beside = circle.center + (centers - circle.center) * 1e-3
    for others in (centers, beside):
        needed = 2 * np.linalg.norm(others[:, None] - points, axis=2).max(axis=1)
        assert needed.min() >= circle.diameter - near(circle.diameter)


@given(clouds, st.floats(-3, 3), st.tuples(coordinates, coordinates), st.floats(0.1, 10))
def test_it_moves_turns_and_grows_with_its_points(points, angle, shift, factor):
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    circle, moved = smallest_circle(points), smallest_circle(factor * points @ R.T + shift)
    assert moved.diameter == pytest.approx(factor * circle.diameter, rel=1e-6, abs=1e-6)


@given(clouds, st.tuples(coordinates, coordinates))
def test_one_more_point_never_makes_it_smaller(points, point):
    larger = smallest_circle(np.vstack([points, point])).diameter
    assert larger >= smallest_circle(points).diameter - near(larger)


def test_known_circles():
    assert smallest_circle(np.array([[3.0, 4.0]])).diameter == 0
    pair = smallest_circle(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.5]]))
    assert (pair.diameter, pair.center.tolist()) == (2.0, [1.0, 0.0])
    angle = np.arange(3) * 2 * np.pi / 3
    three = smallest_circle(np.column_stack([np.cos(angle), np.sin(angle)]))
    assert three.diameter == pytest.approx(2)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.zeros((3, 3)), [[np.nan, 0.0]]])
def test_what_no_circle_goes_around_is_refused(points):
    with pytest.raises(InputError, match="finite points"):
        smallest_circle(points)


def test_the_papers_ten_answers_need_the_circles_that_it_states_but_for_rounding():
    """Its table 3: figure 10 (b) shows 0.604 and 0.503 mm."""
    conventional = [
        (292.068, -86.067),
        (292.297, -86.009),
        (292.429, -86.438),
        (292.660, -86.115),
        (292.279, -86.300),
    ]
    proposed = [
        (292.307, -86.020),
        (292.108, -86.220),
        (292.549, -85.979),
        (292.398, -86.208),
        (292.225, -86.285),
    ]
    diameters = [smallest_circle(np.array(cloud)).diameter for cloud in (conventional, proposed)]
    assert diameters == pytest.approx([0.604, 0.503], abs=1e-3)
