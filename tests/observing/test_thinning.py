"""What a recording leaves out of an arm at rest, and that nothing is judged otherwise without it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vgrd.devices import FlangeReading
from vgrd.devices.stillness import RestLimits, rest_pose
from vgrd.devices.thinning import AROUND_S, HOLD_S, REST_S, PoseThinning
from vgrd.errors import ObservationError
from vgrd.geometry import Pose

LIMITS = RestLimits()
seeds = st.integers(0, 2**32 - 1)


def arm(seed, rate_hz=25.0, seconds=60.0, noise_mm=0.004, moves=4):
    """An arm that stands, moves a little or far now and then, and drifts; readings in order."""
    rng = np.random.default_rng(seed)
    times = 50.0 + np.arange(0.0, seconds, 1.0 / rate_hz)
    x = rng.normal(0.0, noise_mm, (len(times), 3)) + 1e-4 * times[:, None]
    for begin_s in rng.uniform(52.0, 50.0 + seconds, moves):
        far_mm, length_s = 10.0 ** rng.uniform(-2, 2), rng.uniform(0.01, 2.0)
        x[:, 0] += np.interp(times, [begin_s, begin_s + length_s], [0.0, far_mm])
    return [
        FlangeReading(Pose.from_rotvec((0, 0, 0), place), None, float(t), float(t))
        for t, place in zip(times, x, strict=True)
    ]


def thinned(readings, wants=()):
    """What is kept; each want comes as late as a picture can be told."""
    thinning, kept, wants = PoseThinning(), [], sorted(wants)
    for reading in readings:
        while wants and reading.stamp_s >= wants[0] + HOLD_S - AROUND_S - 0.1:
            stamp_s = wants.pop(0)
            thinning.want(stamp_s, stamp_s)
        kept += thinning.add([reading])
    return kept + thinning.rest()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seeds)
def test_what_is_left_out_is_told_by_what_was_kept_before_it(seed):
    readings = arm(seed)
    kept = thinned(readings)
    assert [r.stamp_s for r in kept] == sorted(r.stamp_s for r in kept)
    position = 0
    for reading in readings:
        if position < len(kept) and kept[position] is reading:
            position += 1
            continue
        last = kept[position - 1]
        apart = reading.base_from_wrist.translation - last.base_from_wrist.translation
        assert np.abs(apart).max() <= LIMITS.spread_mm
        assert reading.stamp_s - last.stamp_s < REST_S
    assert position == len(kept)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seeds, st.lists(st.floats(55.0, 100.0), max_size=4))
def test_rest_is_judged_from_the_replay_as_it_was(seed, pictures_s):
    readings = arm(seed)
    kept = thinned(readings, pictures_s)
    for stamp_s in pictures_s:
        assert judged(kept, stamp_s) == judged(readings, stamp_s)


def judged(readings, stamp_s):
    """The pose or why there is none, as the cell judges with what it holds at that time."""
    held = [r for r in readings if stamp_s - AROUND_S <= r.stamp_s <= stamp_s + AROUND_S]
    try:
        return rest_pose(held, stamp_s).matrix().tolist()
    except ObservationError as error:
        return type(error)


def test_a_move_is_recorded_at_once_and_whole():
    thinning = PoseThinning()
    for reading in arm(0, moves=0):
        thinning.add([reading])
    started = arm(0, moves=0)[-1].stamp_s
    kept = []
    for k in range(1, 26):
        pose = Pose.from_rotvec((0, 0, 0), (0.2 * k, 0, 0))
        kept += thinning.add([FlangeReading(pose, None, started + 0.008 * k, 0.0)])
        assert k < 2 or kept[-1].stamp_s == pytest.approx(started + 0.008 * k)
    assert [r.stamp_s for r in kept if r.stamp_s > started] == pytest.approx(
        [started + 0.008 * k for k in range(1, 26)]
    )
    assert kept[0].stamp_s < started - 0.9 * HOLD_S


def test_what_belongs_to_a_picture_or_a_sample_is_given_back_with_the_next_reading():
    thinning, kept = PoseThinning(), []
    readings = arm(0, moves=0)
    for reading in readings[:-1]:
        kept += thinning.add([reading])
    told_s = readings[-2].stamp_s
    assert kept[-1].stamp_s < told_s - 0.7 * HOLD_S
    thinning.want(told_s - 2.0, told_s)
    kept += thinning.add(readings[-1:])
    assert [r for r in kept if r.stamp_s > told_s - 3.0] == [
        r for r in readings if r.stamp_s > told_s - 3.0
    ]


@pytest.mark.parametrize("noise_mm", [0.0, 0.004, 0.008])
def test_an_arm_at_rest_leaves_one_reading_a_second_whatever_its_rate(noise_mm):
    for rate_hz in (5.0, 125.0):
        readings = arm(1, rate_hz, 120.0, noise_mm, moves=0)
        early = sum(reading.stamp_s < 51.1 for reading in readings)
        late = sum(reading.stamp_s > 170.0 - HOLD_S for reading in readings)
        assert len(thinned(readings)) - early - late <= 125


def test_a_change_of_inputs_mode_or_tool_is_recorded():
    still = Pose.from_rotvec((0, 0, 0), (1, 2, 3))
    other = Pose.from_rotvec((0, 0, 0.1), (1, 2, 3))
    for change in ({"digital_inputs": 4}, {"running": False}, {"wrist_from_tcp": other}):
        was = {"wrist_from_tcp": still, "controller_s": 0.0}
        readings = [
            FlangeReading(still, stamp_s=100 + 0.01 * k, **(was | (change if k > 2000 else {})))
            for k in range(2003)
        ]
        assert readings[2002] in thinned(readings[:2003])
        assert readings[2001] in thinned(readings[:2003])
