"""How far an object moved, whether two pictures agree, and until when a picture speaks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.samples import Samples
from fakes.world.world import CellNoise, World
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.serving.vouching import (
    MARGIN_S,
    SLOWEST_S,
    Vouch,
    agree,
    displacement_mm,
    points_in_tag,
)
from vgrd.geometry import Pose
from vgrd.model import CameraPlace, FlangeTag, Plan, Policy, TagObservation, frozen_array

TAG = Samples(0).facts().tag_b


def seen(camera_from_tag: Pose, sigma_mm: float = 0.01, sigma_rad: float = 1e-4) -> TagObservation:
    covariance = np.diag([sigma_mm**2] * 3 + [sigma_rad**2] * 3)
    return TagObservation(
        TAG, camera_from_tag, frozen_array(covariance, 6, 6), np.zeros((4, 2)), 0.1
    )


coordinate = st.floats(-500, 500)
angle = st.floats(-3, 3)
poses = st.builds(
    lambda r, t: Pose.from_rotvec(r, t),
    st.tuples(angle, angle, angle),
    st.tuples(coordinate, coordinate, coordinate),
)


@given(
    poses, poses, st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=5)
)
def test_the_displacement_is_that_of_the_point_that_went_farthest(then, now, points) -> None:
    points = np.array(points)
    ways = [np.linalg.norm(now @ point - then @ point) for point in points]
    assert displacement_mm(points, seen(then), seen(now)) == pytest.approx(max(ways))


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """A rehearsed cell whose targets lie all on one side of its tag."""
    world = World(Layout(), 5, CellNoise.none())
    rehearsal = Rehearsal(world, facts_of(world, tmp_path_factory.mktemp("taught")))
    return rehearsal, calibrate_system(rehearsal.teach(looks=5, spins=4, points=0))


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("turn_rad", [0.02, 0.2, 1.0])
def test_no_coordinate_moves_farther_than_the_displacement_says(taught, policy, turn_rad) -> None:
    """0.02 rad with targets 60 to 85 mm from the axis: what was told as 0.20 mm was 4.2 mm elsewhere."""
    rehearsal, calibration = taught
    rehearsal.stand(retracted_pose(), 0.3)
    then = rehearsal.look().tag_b
    rehearsal.stand(retracted_pose(), 0.3 + turn_rad)
    now = rehearsal.look().tag_b
    for name in calibration.taught:
        before, after = (
            expected_coordinate(calibration, name, tag, policy).base_from_wrist
            for tag in (then, now)
        )
        points = points_in_tag(calibration, before, then)
        way = np.linalg.norm(after.translation - before.translation)
        assert way <= displacement_mm(points, then, now) + 0.05


def test_one_target_far_from_the_tag_moves_as_far_as_it_does(taught) -> None:
    _, calibration = taught
    now = seen(calibration.solution.camera_from_tag_b)
    far = Pose.from_rotvec((0, 0, 0), (0, 200.0, 0))
    answer = calibration.base_from_camera @ now.camera_from_tag @ far
    points = points_in_tag(calibration, answer, now)
    turn = now.camera_from_tag @ Pose.from_rotvec((0, 0, 0.02))
    assert displacement_mm(points, now, seen(turn)) >= 200 * 0.0199


FAR = Pose.from_rotvec((0.4, -0.6, 1.2), (150.0, -200.0, 90.0))


@pytest.mark.parametrize("plan", [Plan.JOINT, Plan.UNIVERSAL])
def test_a_camera_that_people_moved_judges_the_same_points(tmp_path, plan) -> None:
    """The flange and tip in tag B do not depend on where the camera stands that sees them."""
    world = World(Layout(), 5, CellNoise.none())
    rehearsal = Rehearsal(world, facts_of(world, tmp_path))
    recording = rehearsal.teach(looks=5, spins=4, points=0)
    calibration = calibrate_system(replace(recording, plan=plan))
    rehearsal.stand(retracted_pose(), 0.3)
    look = rehearsal.look()
    movable = np.full(6, np.inf)
    points = []
    for shift in (Pose.identity(), FAR):
        tag_a, tag_b = (
            replace(tag, camera_from_tag=shift.inverse() @ tag.camera_from_tag)
            for tag in (look.tag_a, look.tag_b)
        )
        place = CameraPlace(movable, FlangeTag(tag_a, look.base_from_wrist))
        answer = expected_coordinate(calibration, "P1", tag_b, Policy.FIXED, camera=place)
        points.append(
            points_in_tag(calibration, answer.base_from_wrist, tag_b, answer.taught_from_camera)
        )
    np.testing.assert_allclose(points[0], points[1], atol=0.1)


def test_pictures_of_one_place_agree_within_their_noise_and_others_do_not() -> None:
    rng = np.random.default_rng(3)
    place = Pose.from_rotvec((0.2, 0.1, 0.3), (10.0, 20.0, 700.0))
    points = np.array([[0.0, 0, 0], [80, 0, 0], [0, 90, 150.0]])
    observed = seen(place)
    L = np.linalg.cholesky(observed.covariance)

    def noisy(pose: Pose) -> TagObservation:
        tangent = L @ rng.standard_normal(6)
        return seen(Pose.from_rotvec(tangent[3:], tangent[:3]) @ pose)

    assert all(agree(points, noisy(place), noisy(place)) for _ in range(500))
    moved = Pose.from_rotvec((0, 0, 0), (2.0, 0, 0)) @ place
    assert not any(agree(points, noisy(place), noisy(moved)) for _ in range(100))


def test_what_is_not_a_number_never_agrees() -> None:
    point = np.array([[np.nan, 0.0, 0.0]])
    here = seen(Pose.from_rotvec((0, 0, 0), (0, 0, 700.0)))
    assert not agree(point, here, here)
    assert not displacement_mm(point, here, here) <= 0.3


latencies = st.lists(st.floats(0.001, 5.0), min_size=1, max_size=20)


def learnt(latencies_s):
    """Without single stalls: pictures that came after their successor was due, the next one in time."""
    out, stalled = [], False
    for latency_s in latencies_s:
        known_s = min(max(out[-5:], default=0.1), SLOWEST_S)
        late = latency_s > max(0.1, known_s) + known_s + MARGIN_S
        if stalled and not late and len(out) == 1:
            out = []
        if not late or stalled or not out:
            out.append(latency_s)
        stalled = late
    return out


@given(latencies, st.booleans())
def test_a_picture_speaks_for_interval_latency_and_margin(latencies_s, whole) -> None:
    vouch = Vouch(0.1)
    for latency_s in latencies_s:
        vouch.learn(10.0, 10.0 + latency_s, whole=whole)
    slowest_s = min(max(learnt(latencies_s)[-5:]), SLOWEST_S)
    assert vouch.latency_s == pytest.approx(slowest_s)
    vouch.see(20.0, whole=whole)
    assert vouch.until_s == pytest.approx(20.0 + max(0.1, slowest_s) + slowest_s + MARGIN_S)
    vouch.hold(20.1, 20.0, whole=whole)
    assert vouch.until_s <= 20.1
    vouch.end()
    assert vouch.until_s == -np.inf


def test_whole_pictures_count_only_where_the_camera_sends_no_regions() -> None:
    vouch = Vouch(0.1)
    vouch.learn(0.0, 0.5, whole=True)
    assert vouch.latency_s == 0.5
    vouch.learn(0.0, 0.04, whole=False)
    vouch.learn(0.0, 0.6, whole=True)
    assert vouch.latency_s == 0.04


def test_one_picture_that_stalled_lengthens_no_answer_and_two_tell_a_slow_camera():
    vouch = Vouch(0.1)
    for _ in range(3):
        vouch.learn(10.0, 10.04, whole=False)
    span_s = vouch.span_s
    vouch.learn(11.0, 12.5, whole=False)  # triggered before an outage, sent after it
    assert vouch.span_s == pytest.approx(span_s)
    vouch.learn(12.6, 12.64, whole=False)
    assert vouch.span_s == pytest.approx(span_s)
    for now_s in (13.5, 14.0):
        vouch.learn(now_s - 0.5, now_s, whole=False)
    assert vouch.span_s == pytest.approx(0.5 + 0.5 + MARGIN_S)


def test_a_first_picture_that_stalled_counts_until_the_next_one_comes_in_time():
    vouch = Vouch(0.1)
    vouch.learn(10.0, 12.0, whole=False)  # the cell process starts while the camera comes back
    assert vouch.latency_s == SLOWEST_S
    vouch.learn(12.1, 12.14, whole=False)
    assert vouch.latency_s == pytest.approx(0.04)
