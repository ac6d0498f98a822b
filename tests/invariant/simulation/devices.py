"""The two device processes: real checks, rings and health, scripted devices.

What `vgrd.devices.host` does in its loops is done here step by step, since a loop that blocks cannot run in
simulated time; the loops themselves are held by tests/observing.
"""

import asyncio
from pathlib import Path

import numpy as np

from tests.invariant.simulation.pictures import SHAPE, Film
from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.simulated_time import SimulatedClock
from vgrd.devices import CameraImage, FlangeReading, Region, wire
from vgrd.devices.checks import FlangeCheck, FrameCheck
from vgrd.devices.host import (
    BAD_PICTURES_IN_A_ROW,
    GRAB_TIMEOUT_S,
    READ_TIMEOUT_S,
    BadReadings,
    _Triggers,
)
from vgrd.errors import BadReading, DeviceRefused, DeviceUnavailable, InputError
from vgrd.geometry import Pose
from vgrd.ipc.health import BEAT_S, HealthReporter
from vgrd.ipc.messages import Health
from vgrd.ipc.ring import RingWriter

POLL_S = 0.008  # of triggers; the real one looks each 1 ms
READING_S = 0.04  # a robot of 25 Hz, unless a rule says otherwise


class _Reporter(HealthReporter):
    """Health of a simulated process: its beats come from a task, its number is its own."""

    def __init__(self, runtime_dir: Path, process: str, clock: SimulatedClock, pid: int) -> None:
        self._pid = pid
        super().__init__(runtime_dir, process, clock)

    async def beat_on(self) -> None:
        while True:
            self.beat()
            await asyncio.sleep(BEAT_S)

    def _write(self, now_s: float) -> None:
        _, state, detail = self.last_report
        health = Health(self.process, state, self.count, detail, self._pid)
        self.ring.publish(health.pack(), stamp_s=now_s)


class RobotDevice:
    """The controller and its cable. fault: what it does wrong, see `vgrd.devices.checks`.

    frozen: the pose that it goes on telling, whatever the arm does.
    """

    def __init__(self, plant: Plant, clock: SimulatedClock) -> None:
        self.plant, self.clock = plant, clock
        self.is_plugged = True
        self.is_running = True
        self.fault = ""
        self.reading_s = READING_S
        self.frozen: Pose | None = None
        self.stale_s: float | None = None

    def told(self, now_s: float) -> Pose:
        return self.frozen or self.plant.arm.reported_flange(now_s)

    def read(self) -> FlangeReading:
        now, pose = self.clock.monotonic(), self.told(self.clock.monotonic())
        if self.fault == "nan":
            pose = Pose(np.full((3, 3), np.nan), np.zeros(3))
        elif self.fault == "jump":
            self.fault = ""
            pose = Pose(pose.rotation, pose.translation + np.array([500.0, 0, 0]))
        elif self.fault == "far":
            pose = Pose(pose.rotation, 1000 * pose.translation)
        elif self.fault == "ahead":
            now += 5.0
        elif self.fault == "old":
            self.stale_s = self.stale_s or now
            now = self.stale_s
        if self.fault != "old":
            self.stale_s = None
        tcp = self.plant.arm.wrist_from_tcp
        return FlangeReading(pose, tcp, now, now, running=self.is_running)

    async def live(self, runtime_dir: Path, pid: int) -> None:
        """One life of its process, until the device is of no use."""
        async with asyncio.TaskGroup() as tasks:
            health = _Reporter(runtime_dir, "robot", self.clock, pid)
            beating = tasks.create_task(health.beat_on())
            try:
                await self._host(runtime_dir, health)
            except DeviceUnavailable as err:
                health.report("unavailable", str(err))
                beating.cancel()
            except DeviceRefused as err:
                health.report("refused", str(err))
                beating.cancel()

    async def _host(self, runtime_dir: Path, health: _Reporter) -> None:
        if not self.is_plugged:
            raise DeviceUnavailable("not plugged in")
        ring = RingWriter.create(
            runtime_dir / wire.FLANGE_RING,
            slots=wire.FLANGE_SLOTS,
            slot_bytes=wire.FLANGE_BYTES,
            kind=wire.FLANGE_KIND,
        )
        check, bad = FlangeCheck(self.clock), BadReadings()
        while True:
            await asyncio.sleep(self.reading_s)
            if not self.is_plugged:
                await asyncio.sleep(READ_TIMEOUT_S)
                raise DeviceUnavailable("nothing comes")
            try:
                reading = check.accept(self.read())
            except BadReading as err:
                bad.bad(err)
            except InputError as err:
                bad.bad(BadReading(str(err)))
            else:
                bad.good()
                ring.publish(wire.pack_flange(reading), stamp_s=reading.stamp_s)
            health.progress("ok")


class CameraDevice:
    """The camera and its cable; it sends regions, unless `sends_regions` is False.

    fault: "repeat" (number, stamp and pixels), "freeze" (the same pixels, anew), "noise" (no picture of
    anything), "shape", "ahead", "drop" (a picture is lost), "hang".
    """

    def __init__(
        self, plant: Plant, robot: RobotDevice, clock: SimulatedClock, rng: np.random.Generator
    ) -> None:
        self.plant, self.robot, self.clock, self.rng = plant, robot, clock, rng
        self.film = Film(plant, rng)
        self.is_plugged = True
        self.sends_regions = True
        self.fault = ""
        self._frame = 0
        self._last: CameraImage | None = None

    async def live(self, runtime_dir: Path, pid: int) -> None:
        """One life of its process, until the device is of no use."""
        async with asyncio.TaskGroup() as tasks:
            health = _Reporter(runtime_dir, "camera", self.clock, pid)
            beating = tasks.create_task(health.beat_on())
            try:
                await self._host(runtime_dir, health)
            except DeviceUnavailable as err:
                health.report("unavailable", str(err))
                beating.cancel()

    async def _host(self, runtime_dir: Path, health: _Reporter) -> None:
        if not self.is_plugged:
            raise DeviceUnavailable("not plugged in")
        ring = RingWriter.create(
            runtime_dir / wire.IMAGE_RING,
            slots=wire.IMAGE_SLOTS,
            slot_bytes=wire.IMAGE_HEADER_BYTES + SHAPE[0] * SHAPE[1],
            kind=wire.IMAGE_KIND,
            crc=False,
        )
        triggers = _Triggers(runtime_dir / wire.TRIGGER_RING)
        triggers.newest()
        check, bad = FrameCheck(SHAPE[0] * SHAPE[1]), BadReadings(limit=BAD_PICTURES_IN_A_ROW)
        while True:
            health.progress("ok")
            wish = triggers.newest()
            if wish is None:
                await asyncio.sleep(POLL_S)
                continue
            try:
                image = check.accept(await self._grab(wire.unpack_trigger(wish.payload)))
            except BadReading as err:
                bad.bad(err)
                continue
            bad.good()
            ring.publish(wire.pack_image_header(image), image.pixels.data, stamp_s=image.stamp_s)

    async def _grab(self, region: Region | None) -> CameraImage:
        """Expose, and let the picture travel. Raises DeviceUnavailable, BadReading."""
        await asyncio.sleep(self.rng.uniform(0.005, 0.02))
        if self.fault == "hang":
            await asyncio.Event().wait()
        if not self.is_plugged:
            await asyncio.sleep(GRAB_TIMEOUT_S)
            raise DeviceUnavailable("no picture")
        part = region if self.sends_regions else None
        stamp_s = self.clock.monotonic()
        pixels = self.film.expose(stamp_s, self.robot.told(stamp_s), part)
        await asyncio.sleep(self.rng.uniform(0.01, 0.03) if part else self.rng.uniform(0.05, 0.1))
        self._frame += 1
        image = CameraImage(pixels, stamp_s, self._frame, part)
        if self.fault == "drop":
            self.fault = ""
            raise BadReading("incomplete")
        if self.fault == "noise":
            pixels = self.rng.integers(0, 256, SHAPE, dtype=np.uint8)
            image = CameraImage(pixels, stamp_s, self._frame, image.region)
        elif self.fault == "shape":
            image = CameraImage(np.zeros((0, 1920), np.uint8), stamp_s, self._frame)
        elif self.fault == "ahead":
            image = CameraImage(pixels, stamp_s + 5.0, self._frame, image.region)
        elif self.fault == "repeat" and self._last is not None:
            image = self._last
        elif self.fault == "freeze" and self._last is not None:
            image = CameraImage(self._last.pixels, stamp_s, self._frame, image.region)
        self._last = image
        return image
