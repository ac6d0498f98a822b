"""Pictures that no sample can be of: what is kept of them, how much, and who reads it."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.recording.passing import PassingSights
from vgrd.cell.recording.recorder import Recorder
from vgrd.devices import CameraImage, FlangeReading
from vgrd.devices.passing import passing_pose
from vgrd.errors import NotSteady
from vgrd.geometry import Pose
from vgrd.model import MovingSight, Plan
from vgrd.store.encoding import encode
from vgrd.store.recovery import read_messages
from vgrd.store.sessions import (
    SessionWriter,
    iterate_images,
    iterate_moving,
    iterate_observations,
)
from vgrd.store.topics import Topic

SAMPLES = Samples(3)
PIXELS = np.zeros((48, 64), np.uint8)
PERIOD_S = 0.008


def at_x(x_mm):
    return Pose.from_rotvec((0, 0, 0.001 * x_mm), (x_mm, 0, 0))


def sight(stamp_s, x_mm, *, seen=True, moving=True):
    seen_tags = SAMPLES.observation()
    return Sight(
        CameraImage(PIXELS, stamp_s, 1),
        None,
        seen_tags.tag_b if seen else None,
        None if moving else at_x(x_mm),
        NotSteady("it moved") if moving else None,
        passing=at_x(x_mm) if moving else None,
        delay_s=0.02,
    )


def test_a_moving_arm_is_between_its_readings():
    readings = [
        FlangeReading(at_x(100.0 * PERIOD_S * k), None, 5.0 + PERIOD_S * k, 0.0) for k in range(50)
    ]
    passing = passing_pose(readings, 5.1234)
    mm, rad = passing.distance(at_x(12.34))
    assert mm < 1e-6
    assert rad < 1e-9
    assert passing_pose(readings, 4.9) is None
    assert passing_pose(readings, 5.5) is None
    assert passing_pose([], 5.0) is None
    apart = [readings[0], replace(readings[1], stamp_s=7.0)]
    assert passing_pose(apart, 6.0) is None


@pytest.mark.parametrize("delay_s", [0.0, 0.1])
def test_a_picture_of_a_moving_arm_is_paired_after_its_delay(tmp_path, delay_s):
    measuring = Measuring(
        tmp_path, None, SAMPLES.facts(), ManualClock(10.0), 1.0, 10.0, delay_s=delay_s
    )
    measuring.robot.readings.extend(
        FlangeReading(at_x(100.0 * PERIOD_S * k), None, 8.0 + PERIOD_S * k, 0.0)
        for k in range(200)
    )
    seen = measuring._pair(CameraImage(PIXELS, 9.0, 1), {})
    assert seen.base_from_wrist is None
    assert seen.passing.translation[0] == pytest.approx(100.0 * (1.0 + delay_s), abs=1e-3)
    assert (seen.stamp_s, seen.delay_s) == (9.0, delay_s)


def test_a_picture_at_rest_is_paired_with_the_rest_of_its_delayed_time(tmp_path):
    def pair(delay_s):
        measuring = Measuring(
            tmp_path, None, SAMPLES.facts(), ManualClock(10.0), 1.0, 10.0, delay_s=delay_s
        )
        for k in range(250):
            t_s = 8.0 + PERIOD_S * k
            reading = FlangeReading(at_x(100.0 * min(t_s - 8.0, 1.0)), None, t_s, 0.0)
            measuring.robot.readings.append(reading)
            measuring.rests.add([reading])
        return measuring._pair(CameraImage(PIXELS, 9.05, 1), {})

    assert pair(0.1).base_from_wrist.translation[0] == pytest.approx(100.0)
    assert pair(-0.1).base_from_wrist is None


def test_tags_of_a_moving_arm_are_kept_at_a_low_rate_and_bounded(monkeypatch):
    monkeypatch.setattr("vgrd.cell.recording.passing._MOST", 30)
    passing = PassingSights()
    kept = [passing.kept(sight(0.1 * k, float(k))) for k in range(200)]
    stamps = [one.stamp_s for one in kept if one is not None]
    assert len(stamps) == 30
    assert min(np.diff(stamps)) >= 0.3


def test_pictures_without_tags_are_few_and_not_twice_of_one_place(monkeypatch):
    monkeypatch.setattr("vgrd.cell.recording.passing._MOST_UNSEEN", 4)
    passing = PassingSights()

    def count(places):
        sights = [sight(next(clock), x, seen=False, moving=False) for x in places]
        return sum(passing.kept(one) is not None for one in sights)

    clock = iter(np.arange(0, 10_000, 0.5))
    assert count([0.0] * 500) == 1
    assert count([5.0] * 500) == 1
    assert count([0.0] * 500) == 1
    assert count(100.0 * np.arange(500)) == 1


def test_they_are_recorded_beside_what_is_there_and_other_readers_do_not_see_them(tmp_path):
    recorder = Recorder(tmp_path, ManualClock())

    async def record():
        await recorder.start("s", Plan.UNIVERSAL, SAMPLES.facts())
        for k in range(3):
            recorder.on_sight(sight(20.0 + k, float(k)))
        recorder.on_sight(sight(40.0, 0.0, seen=False, moving=False))
        recorder.on_sight(sight(41.0, 3.0, seen=False, moving=False))
        recorder.on_sight(replace(sight(42.0, 0.0), passing=None))
        return await recorder.stop()

    folder = asyncio.run(record())
    kept = list(iterate_moving(folder))
    assert [one.stamp_s for one in kept] == [20.0, 21.0, 22.0, 40.0]
    assert kept[1].base_from_wrist.translation[0] == 1.0
    assert kept[1].taken_s == 21.02
    assert [image.stamp_s for image in iterate_images(folder)] == [40.0]
    assert list(iterate_observations(folder)) == []


def test_a_version_that_knows_three_topics_leaves_the_fourth_out(tmp_path):
    with SessionWriter(tmp_path, "s", Plan.JOINT, SAMPLES.facts(), ManualClock()) as writer:
        writer.observation(SAMPLES.observation())
        moving = MovingSight(SAMPLES.pose(), 1.0, SAMPLES.observation().tag_b, None, 0.01)
        writer.moving(moving)
    old = frozenset({Topic.FLANGE, Topic.OBSERVATION, Topic.IMAGE})
    (segment,) = writer.path.glob("*.mcap")
    assert [message.topic for message in read_messages(segment, old)] == [Topic.OBSERVATION]
    (found,) = iterate_moving(writer.path)
    assert encode(found) == encode(moving)
