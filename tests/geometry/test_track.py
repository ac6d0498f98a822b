"""A track goes through its poses, follows a curve between them, and says where it knows nothing."""

import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.geometry import Pose, exp_rotation, log_rotation
from vgrd.geometry.track import PoseTrack


def swinging(t):
    """A flange that swings and turns; its parts are told by hand."""
    position = np.array([100 * np.sin(t), 50 * np.cos(2 * t), 20 * t])
    return Pose(exp_rotation((0.3 * np.sin(t), 0.2 * t, 0.0)), position)


def track_of(times):
    return PoseTrack.of(list(times), [swinging(t) for t in times])


def test_it_goes_through_every_pose_in_whatever_order_they_come():
    times = np.random.default_rng(1).permutation(np.arange(0, 2, 0.1))
    R, p = track_of(times).at(times)
    for k, t in enumerate(times):
        np.testing.assert_allclose(p[k], swinging(t).translation, atol=1e-9)
        np.testing.assert_allclose(R[k], swinging(t).rotation, atol=1e-9)


def test_between_poses_it_errs_with_the_third_power_of_the_step():
    times = np.linspace(0.5, 1.5, 57)
    worst = []
    for step in (0.1, 0.05):
        track = track_of(np.arange(0, 2.0001, step))
        R, p = track.at(times)
        truth = [swinging(t) for t in times]
        worst.append(max(np.linalg.norm(a - b.translation) for a, b in zip(p, truth, strict=True)))
        turns = [log_rotation(a @ b.rotation.T) for a, b in zip(R, truth, strict=True)]
        assert np.abs(turns).max() < 2e-3 * step
    assert worst[0] < 0.05
    assert worst[1] < worst[0] / 5


def test_twists_carry_a_pose_on():
    track, h = track_of(np.arange(0, 2, 0.01)), 0.02
    times = np.array([0.4, 0.9, 1.3])
    for t, twist in zip(times, track.twists(times, h), strict=True):
        there = Pose.exp(2 * h * twist) @ swinging(t - h)
        mm, rad = there.distance(swinging(t + h))
        assert mm < 0.01
        assert rad < 1e-5


def test_gaps_and_the_time_beyond_the_ends_are_not_covered():
    track = track_of([0.0, 0.1, 0.2, 0.9, 1.0])
    covered = track.covers(np.array([-0.1, 0.05, 0.5, 0.95, 1.1]), 0.15)
    assert covered.tolist() == [False, True, False, True, False]
    _, p = track.at(np.array([-5.0, 9.0]))
    np.testing.assert_allclose(p, [swinging(0.0).translation, swinging(1.0).translation])


def test_one_instant_is_no_track():
    with pytest.raises(InputError, match="two different times, got 1"):
        track_of([0.5, 0.5, 0.5])
