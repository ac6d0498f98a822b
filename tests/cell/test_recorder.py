"""What a session costs: little while nothing happens, all that matters while something does."""

import asyncio
import shutil
from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.cell.measuring import Sight
from vgrd.cell.recording.housekeeping import TOLD, Housekeeping
from vgrd.cell.recording.recorder import Recorder
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import StoreError
from vgrd.geometry import Pose
from vgrd.model import Plan
from vgrd.store.retention import Room
from vgrd.store.sessions import (
    SampleKind,
    iterate_flanges,
    iterate_images,
    load_session,
)

RATE_HZ = 125.0
NOISE_MM, NOISE_RAD = 0.004, 5e-6
PICTURE = np.random.default_rng(0).integers(0, 200, (48, 64)).astype(np.uint8)
SAMPLES = Samples(3)
DAY_BYTES = 200e6


class Idle:
    """An arm at rest in front of a camera, on a clock that a test moves."""

    def __init__(self, state_dir):
        rng = np.random.default_rng(1)
        self.clock = ManualClock()
        self.recorder = Recorder(state_dir, self.clock)
        self.poses = [
            Pose.from_rotvec(rng.normal((0.1, 3.0, 0.2), NOISE_RAD), place)
            for place in rng.normal((400, -120, 300), NOISE_MM, (997, 3))
        ]
        self.tool = SAMPLES.pose()
        self.tag = SAMPLES.observation().tag_b
        self.count = 0

    async def run(self, seconds):
        """Pass so many seconds, one at a time."""
        for _ in range(round(seconds)):
            start_s = self.clock.monotonic()
            readings = []
            for k in range(int(RATE_HZ)):
                self.count += 1
                stamp_s = start_s + k / RATE_HZ
                pose = self.poses[self.count % len(self.poses)]
                readings.append(FlangeReading(pose, self.tool, stamp_s, stamp_s))
            self.clock.sleep(1.0)
            self.recorder.on_readings(readings)
            self.recorder.on_sight(self.sight())
            self.recorder.tick()
            await self.fit_joint()

    async def fit_joint(self):
        """Let the writer's thread catch up."""
        await asyncio.get_running_loop().run_in_executor(self.recorder._executor, lambda: None)

    def sight(self, shift_px=0.0, wrist=None, seen=True):
        noise = np.random.default_rng(self.count).normal(0, 0.03, (4, 2))
        tag = replace(self.tag, corners_px=self.tag.corners_px + noise + shift_px)
        image = CameraImage(PICTURE, self.clock.monotonic() - 0.5, self.count)
        tag_a = SAMPLES.tag(self.tag.tag)
        return Sight(image, tag_a, tag if seen else None, wrist or self.poses[0], None)


def size_of(folder):
    return sum(path.stat().st_size for path in folder.iterdir())


def recorded(idle, steps):
    """Run a session; its folder."""

    async def run():
        await idle.recorder.start("s", Plan.UNIVERSAL, SAMPLES.facts())
        await steps()
        return await idle.recorder.stop()

    return asyncio.run(run())


def test_an_idle_day_with_an_open_session_takes_less_than_200_mb(tmp_path):
    idle = Idle(tmp_path)
    folder = recorded(idle, lambda: idle.run(600))
    idle_s, counted = 480, list(iterate_flanges(folder))
    quiet = sum(100 < r.stamp_s - counted[0].stamp_s < 100 + idle_s for r in counted)
    assert quiet <= idle_s
    each = size_of(folder) / len(counted)
    assert size_of(folder) + each * 86_400 * quiet / idle_s < DAY_BYTES
    assert len(list(iterate_images(folder))) == 1
    stamps = [reading.stamp_s for reading in iterate_flanges(folder)]
    assert max(np.diff(stamps)) < 1.1
    assert stamps[-1] == pytest.approx(idle.clock.monotonic() - 1 / RATE_HZ)


def test_around_a_picture_and_a_sample_every_reading_is_kept(tmp_path):
    idle = Idle(tmp_path)

    async def steps():
        await idle.run(30)
        idle.recorder.on_sight(idle.sight(shift_px=5.0))
        idle.pictured_s = idle.clock.monotonic() - 0.5
        await idle.run(30)
        idle.sampled_s = idle.clock.monotonic()
        await idle.recorder.call(lambda w: w.sample(SampleKind.TOUCH, SAMPLES.touch()))
        await idle.run(30)

    folder = recorded(idle, steps)
    stamps = np.array([reading.stamp_s for reading in iterate_flanges(folder)])
    for stamp_s in (idle.pictured_s, idle.sampled_s - 1.0):
        assert np.count_nonzero(np.abs(stamps - stamp_s) < 1.0) >= 2 * RATE_HZ - 1
    assert len(stamps) < 20 * RATE_HZ


def test_a_picture_is_recorded_once_for_each_place_of_a_rest(tmp_path):
    idle = Idle(tmp_path)

    async def steps():
        for k in range(40):
            idle.count += 1
            idle.recorder.on_sight(idle.sight(seen=k % 3 != 0))
        for shift_px in (3.0, 0.0, 3.0, 6.0):
            idle.recorder.on_sight(idle.sight(shift_px=shift_px))
        idle.recorder.on_sight(idle.sight(wrist=SAMPLES.pose()))
        idle.recorder.on_sight(idle.sight())
        await idle.fit_joint()

    folder = recorded(idle, steps)
    # without the tag, with it, moved, moved on; elsewhere; back again: a new rest.
    assert len(list(iterate_images(folder))) == 6


def test_the_picture_after_a_sample_is_kept_though_nothing_moved(tmp_path):
    idle = Idle(tmp_path)

    async def steps():
        for _ in range(3):
            for _ in range(4):
                idle.count += 1
                idle.recorder.on_sight(idle.sight())
            await idle.recorder.call(lambda w: w.sample(SampleKind.TOUCH, SAMPLES.touch()))

    assert len(list(iterate_images(recorded(idle, steps)))) == 3


def test_a_session_that_was_forgotten_open_is_told(tmp_path):
    idle = Idle(tmp_path)

    async def steps():
        assert idle.recorder.warning() == ""
        idle.clock.sleep(13 * 3600)
        assert "open for 13 hours: end it with vgrd record stop" in idle.recorder.warning()

    recorded(idle, steps)
    assert idle.recorder.warning() == ""


Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def disk(monkeypatch):
    """How much is free; set by a test."""
    space = {"free": 50e9}
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(100e9, 0, space["free"]))
    return space


def test_a_disk_that_runs_full_pauses_the_recording_and_samples_go_on(tmp_path, disk):
    idle = Idle(tmp_path)
    house = Housekeeping(tmp_path, idle.recorder, quota_gb=1.0, keep_free_gb=2.0)

    async def steps():
        with ThreadPoolExecutor(1) as thread:
            await house.sweep(thread)
            await idle.run(20)
            disk["free"] = 1.9e9
            await house.sweep(thread)
            idle.paused_s = idle.clock.monotonic()
            await idle.run(20)
            assert "1.9 GB are free" in idle.recorder.warning()
            assert "free space on it" in house.status()["trouble"]
            await idle.recorder.call(lambda w: w.sample(SampleKind.TOUCH, SAMPLES.touch()))
            disk["free"] = 2.1e9
            await house.sweep(thread)
            assert idle.recorder.paused
            disk["free"] = 2.3e9
            await house.sweep(thread)
            assert idle.recorder.warning() == ""
            idle.resumed_s = idle.clock.monotonic()
            await idle.run(20)

    folder = recorded(idle, steps)
    stamps = [reading.stamp_s for reading in iterate_flanges(folder)]
    assert stamps == sorted(stamps)
    assert not [s for s in stamps if idle.paused_s <= s < idle.resumed_s]
    assert stamps[-1] > idle.resumed_s + 15
    assert len(load_session(folder).recording.touches) == 1


def test_an_open_session_over_the_quota_is_paused_not_removed(tmp_path, disk):
    idle = Idle(tmp_path)
    house = Housekeeping(tmp_path, idle.recorder, quota_gb=1e-6, keep_free_gb=0.0)

    async def steps():
        with ThreadPoolExecutor(1) as thread:
            await idle.run(5)
            await house.sweep(thread)
        assert "all are needed" in idle.recorder.warning()
        assert house.status()["removed"] == []
        before = size_of(idle.recorder.writer.path)
        await idle.run(30)
        assert size_of(idle.recorder.writer.path) == before

    assert (recorded(idle, steps) / "session.json").exists()


def test_a_state_folder_that_cannot_be_used_pauses_the_recording_in_words(tmp_path):
    (tmp_path / "state").write_text("a file")
    recorder = Recorder(tmp_path / "state", ManualClock())
    house = Housekeeping(tmp_path / "state", recorder, quota_gb=1.0, keep_free_gb=0.0)

    async def run():
        with ThreadPoolExecutor(1) as thread:
            await house.sweep(thread)

    asyncio.run(run())
    assert "cannot look after" in house.status()["trouble"]


def test_what_was_removed_is_told(tmp_path, disk):
    idle = Idle(tmp_path)
    house = Housekeeping(tmp_path, idle.recorder, quota_gb=1e-6, keep_free_gb=0.0)

    async def run():
        for name in "abc":
            await idle.recorder.start(name, Plan.UNIVERSAL, SAMPLES.facts())
            await idle.recorder.stop()
        with ThreadPoolExecutor(1) as thread:
            await house.sweep(thread)

    asyncio.run(run())
    assert house.status()["removed"] == ["a"]
    assert house.status()["removed_total"] == 1


@pytest.fixture
def house(tmp_path, disk):
    recorder = Recorder(tmp_path, ManualClock())
    return Housekeeping(tmp_path, recorder, quota_gb=50.0, keep_free_gb=0.0)


def sweep(house, times=1):
    async def run():
        with ThreadPoolExecutor(1) as thread:
            for _ in range(times):
                await house.sweep(thread)

    asyncio.run(run())


def fail(*_):
    raise StoreError("Input/output error")


@pytest.mark.parametrize("failing", ["_make_room", "_look"])
def test_what_is_not_known_of_the_disk_now_is_not_told(house, monkeypatch, failing):
    for _ in range(2):
        assert house.status()["free_gb"] is house.status()["sessions_gb"] is None
        sweep(house)
        assert (house.status()["free_gb"], house.status()["sessions_gb"]) == (50.0, 0.0)
        with monkeypatch.context() as patched:
            patched.setattr(house, failing, fail)
            sweep(house)
        assert "Input/output error" in house.status()["trouble"]


def test_a_session_that_gave_way_is_counted_once_whatever_fails_later(house, monkeypatch):
    looks = [house._look, fail, fail]
    monkeypatch.setattr(house, "_make_room", lambda: Room(1, ("a", "b")))
    for look in looks:
        monkeypatch.setattr(house, "_look", look)
        sweep(house)
    assert house.status()["removed_total"] == 6
    monkeypatch.setattr(house, "_make_room", fail)
    sweep(house, 3)
    assert house.status()["removed_total"] == 6
    assert house.status()["removed"] == ["a", "b"] * 3


def test_a_status_names_the_last_that_gave_way_and_counts_all(house, monkeypatch):
    names = (f"s{number}" for number in range(1000))
    monkeypatch.setattr(house, "_make_room", lambda: Room(1, (next(names),)))
    sweep(house, 1000)
    told = house.status()
    assert told["removed_total"] == 1000
    assert told["removed"] == [f"s{number}" for number in range(1000 - TOLD, 1000)]
