"""A press of a button is about now: readings from before it never answer it."""

import asyncio
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.cell.measuring import Measuring, Sight
from vgrd.devices import CameraImage, FlangeReading, Pixels, Region, wire
from vgrd.errors import NotSteady
from vgrd.geometry import Array, Pose
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.model import TagObservation, frozen_array

PERIOD_S = 0.008


FACTS = Samples(0).facts()
WIDTH, HEIGHT = FACTS.image_size_px


class Eyes:
    """A detector that finds tag B where the test has put it, in whole pictures and in regions."""

    def __init__(self) -> None:
        self.corners_px: Array | None = None

    def detect(
        self,
        pixels: Pixels,
        previous: Mapping[int, TagObservation] | None = None,
        region: Region | None = None,
    ) -> dict[int, TagObservation]:
        del previous
        part = region or Region(0, 0, WIDTH, HEIGHT)
        assert pixels.shape == (part.height, part.width)
        if self.corners_px is None or not _inside(self.corners_px, part):
            return {}
        pose = Pose.from_rotvec((0, 0, 0), (0, 0, 700.0))
        covariance = frozen_array(1e-4 * np.eye(6), 6, 6)
        seen = TagObservation(FACTS.tag_b, pose, covariance, self.corners_px, 0.1)
        return {FACTS.tag_b.id: seen}


def _inside(corners_px: Array, part: Region) -> bool:
    low, high = corners_px.min(0), corners_px.max(0)
    return bool(
        (low >= (part.x, part.y)).all()
        and (high <= (part.x + part.width, part.y + part.height)).all()
    )


class ScriptedCamera:
    """Answers triggers as a camera's process does; `regions`: whether it has that mode."""

    def __init__(self, runtime: Path, clock: ManualClock, *, regions: bool = True) -> None:
        self.clock = clock
        self.regions = regions
        self.asked: list[Region | None] = []
        self.ahead_s = 0.0
        self.ring = RingWriter.create(
            runtime / wire.IMAGE_RING,
            wire.IMAGE_SLOTS,
            wire.IMAGE_HEADER_BYTES + WIDTH * HEIGHT,
            wire.IMAGE_KIND,
            crc=False,
        )
        self.triggers = RingReader.open(runtime / wire.TRIGGER_RING, wire.TRIGGER_KIND)

    def serve(self) -> None:
        """One picture for the newest trigger, if there is a new one."""
        if self.triggers.index == len(self.asked):
            return
        message = self.triggers.newest()
        assert message is not None
        wanted = wire.unpack_trigger(message.payload)
        self.asked.append(wanted)
        region = wanted if self.regions else None
        shape = (HEIGHT, WIDTH) if region is None else (region.height, region.width)
        image = CameraImage(
            np.zeros(shape, np.uint8),
            self.clock.monotonic() + self.ahead_s,
            len(self.asked),
            region,
        )
        self.ring.publish(wire.pack_image_header(image), image.pixels.data, stamp_s=image.stamp_s)


def at(stamp_s: float, x_mm: float) -> FlangeReading:
    return FlangeReading(Pose.from_rotvec((0, 0, 0), (x_mm, 0, 0)), None, stamp_s, stamp_s)


@pytest.fixture
def measuring(tmp_path: Path) -> Measuring:
    clock = ManualClock(1000.0)
    return Measuring(tmp_path, Eyes(), FACTS, clock, 1.0, 10.0)


def test_the_pose_of_a_press_comes_from_readings_after_it(measuring: Measuring) -> None:
    measuring.robot.readings.extend(at(999.5 + PERIOD_S * k, 0.0) for k in range(60))

    async def press() -> Pose:
        pressed = asyncio.create_task(measuring.rest())
        await asyncio.sleep(0.02)
        assert not pressed.done()
        measuring.robot.readings.extend(at(1000.0 + PERIOD_S * k, 5.0) for k in range(10))
        return await pressed

    assert asyncio.run(press()).translation[0] == 5.0


def test_an_arm_that_goes_on_moving_is_not_steady(measuring: Measuring) -> None:
    measuring.robot.readings.extend(at(999.9 + PERIOD_S * k, 0.1 * k) for k in range(100))
    with pytest.raises(NotSteady):
        asyncio.run(measuring.rest())


SQUARE = np.array([[0.0, 0], [100, 0], [100, 100], [0, 100]])


class Loop:
    """The measuring loop, stepped by hand: 10 ms of the clock each."""

    def __init__(self, measuring: Measuring, camera: ScriptedCamera, clock: ManualClock) -> None:
        self.measuring, self.camera, self.clock = measuring, camera, clock
        self.whole: list[Sight] = []
        self.every: list[Sight] = []
        measuring.on_sight.append(self.whole.append)
        measuring.on_watch.append(self.every.append)

    def run(self, seconds: float) -> list[Region | None]:
        """What the camera was asked for meanwhile."""

        async def steps() -> None:
            async with asyncio.TaskGroup() as tasks:
                end_s = self.clock.monotonic() + seconds
                while self.clock.monotonic() < end_s:
                    self.measuring._step(tasks)
                    self.camera.serve()
                    self.measuring._step(tasks)
                    if (evaluation := self.measuring._evaluation) is not None:
                        await asyncio.wait({evaluation})
                    self.clock.sleep(0.01)

        before = len(self.camera.asked)
        asyncio.run(steps())
        return self.camera.asked[before:]


@pytest.fixture(params=[True, False], ids=["regions", "whole"])
def loop(request: pytest.FixtureRequest, tmp_path: Path) -> Loop:
    clock = ManualClock(1000.0)
    measuring = Measuring(tmp_path, Eyes(), FACTS, clock, 1.0, 10.0)
    measuring.robot.readings.append(at(1e9, 0.0))  # nobody waits for readings after a picture
    measuring.detector.corners_px = SQUARE + 300  # type: ignore[attr-defined]
    return Loop(measuring, ScriptedCamera(tmp_path, clock, regions=request.param), clock)


def test_nobody_watches_while_no_answer_stands_but_for_one_picture_that_tells_the_time(
    loop: Loop,
) -> None:
    asked = loop.run(5.0)
    assert asked.count(None) in (5, 6)
    assert len(asked) - asked.count(None) == 1
    assert len(loop.whole) == len([sight for sight in loop.every if sight.is_whole])


def test_the_region_around_the_tag_is_watched_while_an_answer_stands(loop: Loop) -> None:
    loop.run(2.0)
    loop.measuring.watching = True
    seen, asked = len(loop.every), loop.run(2.0)
    assert 18 <= len(asked) <= 22
    if loop.camera.regions:
        assert set(asked) == {Region(250, 250, 200, 200)}
        assert not any(sight.is_whole for sight in loop.every[seen:])
    assert all(sight.tag_b is not None for sight in loop.every[seen:])
    loop.measuring.watching = False
    assert len(loop.run(2.0)) <= 3


def test_a_tag_that_left_its_region_is_looked_for_in_whole_pictures(loop: Loop) -> None:
    loop.run(2.0)
    loop.measuring.watching = True
    loop.run(0.5)
    loop.measuring.detector.corners_px = SQUARE + 500  # type: ignore[attr-defined]
    loop.run(0.3)
    stamps = [sight.tag_b.corners_px[0, 0] for sight in loop.every if sight.tag_b is not None]
    assert stamps[-1] == 500
    if loop.camera.regions:
        assert any(sight.tag_b is None for sight in loop.every)
        assert loop.run(0.3)[-1] == Region(450, 450, 200, 200)


def test_a_wish_for_a_whole_picture_is_not_answered_by_a_region(loop: Loop) -> None:
    loop.run(2.0)
    loop.measuring.watching = True

    async def ask(*, whole: bool) -> Sight:
        wish = asyncio.create_task(loop.measuring.fresh(5.0, whole=whole))
        await asyncio.sleep(0)
        async with asyncio.TaskGroup() as tasks:
            while not wish.done():
                loop.measuring._step(tasks)
                loop.camera.serve()
                loop.clock.sleep(0.01)
                await asyncio.sleep(0.001)
        return wish.result()

    assert asyncio.run(ask(whole=True)).is_whole
    assert asyncio.run(ask(whole=False)).is_whole is not loop.camera.regions


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 20.0, 125.0])
def test_a_slow_robot_is_online_between_its_readings_and_a_silent_one_is_not(
    measuring: Measuring, rate_hz: float
) -> None:
    clock = measuring.clock
    assert isinstance(clock, ManualClock)
    for k in range(20):
        measuring.robot.readings.append(at(clock.monotonic(), float(k)))
        clock.sleep(0.99 / rate_hz)
        assert k < 3 or measuring.reading() is not None
        clock.sleep(0.01 / rate_hz)
    clock.sleep(max(0.2, 1.0 / rate_hz + 0.1))
    assert measuring.reading() is None
    assert "robot" in measuring.robot_trouble()


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 25.0, 40.0])
def test_a_press_is_answered_by_a_slow_robot(measuring: Measuring, rate_hz: float) -> None:
    measuring.robot.readings.extend(at(1000.0 + (k - 9) / rate_hz, 3.0) for k in range(14))
    assert asyncio.run(measuring.rest()).translation[0] == 3.0


def test_a_picture_of_the_future_is_not_believed(loop: Loop) -> None:
    loop.run(2.0)
    seen = len(loop.every)
    loop.camera.ahead_s = 5.0
    loop.run(2.0)
    assert len(loop.every) == seen
    assert "ahead of now" in loop.measuring._unusable
