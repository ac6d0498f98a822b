"""Since when the arm stands: what shares the error of one stop, and what does not."""

import numpy as np

from fakes.world.arm import Arm
from vgrd.devices import FlangeReading
from vgrd.devices.rests import SILENCE_S, Rests
from vgrd.geometry import Pose

PERIOD_S = 0.008


def readings(place_mm, start_s, seconds):
    """Readings of an arm that stands at x = place_mm."""
    stamps = start_s + np.arange(0, seconds, PERIOD_S)
    rng = np.random.default_rng(1)
    return [
        FlangeReading(
            Pose(np.eye(3), np.array([place_mm, 0, 0]) + rng.uniform(-0.01, 0.01, 3)),
            None,
            float(t),
            float(t),
            7,
        )
        for t in stamps
    ]


def test_pictures_of_one_rest_share_its_begin():
    rests = Rests()
    for batch in np.array_split(np.arange(250), 7):
        rests.add([readings(300.0, 10.0, 2.0)[i] for i in batch])
    assert rests.since_s(10.5) == rests.since_s(11.9) == 10.0


def test_an_arm_that_left_and_came_back_stands_anew():
    rests = Rests()
    rests.add(readings(300.0, 10.0, 1.0))
    rests.add(readings(300.3, 11.0, 0.1))
    rests.add(readings(300.0, 11.2, 1.0))
    assert rests.since_s(10.9) == 10.0
    assert rests.since_s(12.0) == 11.2


def test_a_creep_ends_a_rest_although_each_step_is_small():
    rests = Rests()
    for i, batch in enumerate(np.linspace(300.0, 300.5, 20)):
        rests.add(readings(batch, 10.0 + 0.1 * i, 0.1))
    assert rests.since_s(11.95) > rests.since_s(10.5) > 10.0


def test_a_silence_in_which_the_arm_may_have_moved_ends_a_rest():
    rests = Rests()
    rests.add(readings(300.0, 10.0, 1.0))
    rests.add(readings(300.0, 11.0 + SILENCE_S, 1.0))
    assert rests.since_s(11.5 + SILENCE_S) == 11.0 + SILENCE_S


def test_nothing_is_known_before_the_first_reading():
    rests = Rests()
    assert rests.since_s(10.0) is None
    rests.add(readings(300.0, 10.0, 1.0))
    assert rests.since_s(9.9) is None


def test_a_moving_arm_fills_no_memory():
    rests = Rests()
    for i in range(3):
        rests.add(
            [
                r
                for k in range(2000)
                for r in readings(float(k), 10.0 + 16 * i + PERIOD_S * k, 0.001)
            ]
        )
    rests.add(readings(0.0, 80.0, 1.0))
    assert rests.since_s(80.9) == 80.0


def test_the_fake_arm_errs_anew_only_where_it_moved():
    arm = Arm(Pose.identity(), Pose.identity(), seed=1)
    away = Pose(np.eye(3), np.array([100.0, 0, 0]))
    now = arm.move_flange(away, 0.0)
    first = arm.true_flange(now).translation
    assert arm.move_flange(away, now + 1.0) == now + 1.0
    np.testing.assert_array_equal(arm.true_flange(now + 2.0).translation, first)
    back = arm.move_flange(Pose.identity(), now + 3.0)
    again = arm.move_flange(away, back)
    assert np.linalg.norm(arm.true_flange(again).translation - first) > 1e-3
