"""One perfect rehearsed cell, and a `Serving` on a bench whose pictures, robot and clock are set by hand."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.testing import ManualClock
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.world import CellNoise, World
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import Limits
from vgrd.cell.serving.service import Serving
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import DeviceUnavailable
from vgrd.geometry import Array, Pose
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.model import Policy
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REQUEST,
    Command,
    RegisterImage,
    Request,
    Status,
)

STABILITY = np.array([0.5] * 3 + [5e-4] * 3)  # as in the cell file
LIMITS = Limits(Policy.FIXED, 3.0, 1.0, 0.9, 0.3)
CALIBRATION_ID = 0xC0FFEE
NONCE = 2**63 + 5


class Taught:
    """One perfect rehearsed cell, shared by the tests of this room."""

    def __init__(self, folder: Path) -> None:
        self.world = World(Layout(), 5, CellNoise.none())
        self.rehearsal = Rehearsal(self.world, facts_of(self.world, folder))
        recording = self.rehearsal.teach(looks=5, spins=4, points=0)
        self.calibration = calibrate_system(recording)
        self.rehearsal.stand(retracted_pose(), 0.7)
        self.sight = self.see(1000.0)

    def see(self, stamp_s: float) -> Sight:
        seen = self.rehearsal.look()
        image = CameraImage(np.zeros((2, 2), np.uint8), stamp_s, 1)
        return Sight(image, seen.tag_a, seen.tag_b, seen.base_from_wrist, None, seen.rest_since_s)


def request(*, oriented: bool = True, **fields: int) -> Request:
    values = dict.fromkeys((field.name for field in REQUEST.fields), 0)
    values |= {"TRIG": 7, "CMD": Command.EC_FRESH, "POINT": 1} | fields
    return Request.parse(REQUEST.encode(values), NONCE, orientation_written=oriented)


class StillMeasuring:
    """A measuring loop of the tests: what it sees is set by hand.

    `coming`: pictures that answer the next wishes; the last of them goes on being seen.
    """

    def __init__(self, clock: ManualClock, sight: Sight, tcp: Pose | None) -> None:
        self.clock = clock
        self.sight: Sight | None = sight
        self.coming: list[Sight] = []
        self.tcp = tcp
        self.flange = Pose.identity()
        self.beat = 0
        self.period_s, self.watch_period_s = 0.5, 0.1
        self.watching = False
        self.on_watch: list[Callable[[Sight], None]] = []
        self.robot = self
        self.running = True
        self.wishes = 0
        self.troubles = {"robot": "", "camera": "", "blind": ""}

    def newest(self, within_s: float) -> FlangeReading | None:
        del within_s
        if self.troubles["robot"]:
            return None
        now = self.clock.monotonic()
        return FlangeReading(self.flange, self.tcp, now, now, running=self.running)

    def reading(self) -> FlangeReading | None:
        return self.newest(0.0)

    def robot_trouble(self) -> str:
        return self.troubles["robot"]

    def camera_trouble(self) -> str:
        return self.troubles["camera"]

    def camera_blind(self) -> str:
        return self.troubles["camera"] or self.troubles["blind"]

    async def fresh(self, timeout_s: float, *, whole: bool = True) -> Sight:
        del whole
        self.wishes += 1
        if self.coming:
            self.show(self.coming.pop(0))
        elif self.sight is not None:
            self.show(at(self.sight, self.clock.monotonic()))
        if self.sight is None:
            raise DeviceUnavailable(f"no picture within {timeout_s} s")
        return self.sight

    def watched(self, sight: Sight) -> None:
        """A region is seen, not the whole picture."""
        for listener in self.on_watch:
            listener(sight)

    def show(self, sight: Sight) -> None:
        self.sight = sight
        for listener in self.on_watch:
            listener(sight)


def at(sight: Sight, stamp_s: float) -> Sight:
    """The same view, seen at another time."""
    return replace(sight, image=replace(sight.image, stamp_s=stamp_s))


class Bench:
    """A `Serving` on a bench: request it, read its registers."""

    def __init__(
        self,
        folder: Path,
        taught: Taught,
        limits: Limits = LIMITS,
        stability: Array = STABILITY,
    ) -> None:
        self.clock = ManualClock(1000.2)
        facts = taught.calibration.facts
        self.measuring = StillMeasuring(self.clock, taught.sight, facts.wrist_from_tcp)
        writer = RingWriter.create(folder / "registers.ring", 4, PACKED_BYTES, REGISTER_KIND)
        self.serving = Serving(
            self.measuring,  # type: ignore[arg-type]
            writer,
            limits,
            stability,
            self.clock,
            simulation=True,
        )
        self.serving.use(taught.calibration, CALIBRATION_ID)
        self.reader = RingReader.open(folder / "registers.ring", REGISTER_KIND)
        self.measuring.show(taught.sight)

    def ask(self, **fields: int) -> RegisterImage:
        async def serve() -> None:
            async with asyncio.TaskGroup() as self.serving._tasks:
                self.serving.request(request(**fields))

        asyncio.run(serve())
        image = self.read()
        assert image.answer.nonce == NONCE
        return image

    def read(self) -> RegisterImage:
        self.serving.faults.check_tcp()
        self.serving.publish()
        message = self.reader.newest()
        assert message is not None
        return RegisterImage.unpack(message.payload)

    def status_after(self, seconds: float) -> Status:
        """What a robot reads so much later, and that the registers had expired by themselves if it is over."""
        until_s = self.read().answer.valid_until_s
        self.clock.sleep(seconds)
        status = self.read().answer.status
        assert status.is_ok or self.clock.monotonic() >= until_s
        return status


def turned(taught: Taught, angle_rad: float, stamp_s: float) -> Sight:
    """What is seen when the table has turned."""
    taught.rehearsal.stand(retracted_pose(), 0.7 + angle_rad)
    try:
        return taught.see(stamp_s)
    finally:
        taught.rehearsal.stand(retracted_pose(), 0.7)


def hidden(sight: Sight, stamp_s: float) -> Sight:
    return replace(at(sight, stamp_s), tag_b=None)
