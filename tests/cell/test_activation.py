"""Which calibration serves: never one of another cell, never silently none, and never at the cost of the loop."""

import asyncio
import json
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from filelock import FileLock

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.calibration.calibration import Calibration
from vgrd.cell.serving.activation import Activation
from vgrd.cell.serving.answering import Limits
from vgrd.cell.serving.service import Serving
from vgrd.errors import CalibrationMismatch, InputError, StoreError
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.model import Finding, Policy, Verdict
from vgrd.registers import PACKED_BYTES, REGISTER_KIND, RegisterImage, State, Status
from vgrd.solving.servable import check_usable
from vgrd.store import calibrations
from vgrd.store.calibrations import CalibrationStore, StoredCalibration

LIMITS = Limits(Policy.FIXED, 3.0, 1.0, 0.9, 0.3)
LONG_S = 10.0  # a test that waits so long for an event has failed


class Idle:
    """A measuring loop with nothing in it, robot and camera well."""

    def __init__(self) -> None:
        self.on_watch: list[Callable[[object], None]] = []
        self.period_s, self.watch_period_s = 0.5, 0.1
        self.watching = False
        self.robot = self
        self.sight = None
        self.beat = 0

    def newest(self, within_s: float) -> None:
        return None

    def reading(self) -> None:
        return None

    def robot_trouble(self) -> str:
        return ""

    def camera_trouble(self) -> str:
        return ""

    def camera_blind(self) -> str:
        return ""


class Bench:
    """`Serving` and `Activation` over a real store; the registers can be read."""

    def __init__(self, folder: Path, calibration: Calibration) -> None:
        self.store = CalibrationStore(folder, ManualClock())
        self.name = self.store.save(calibration)
        self.path = folder / "registers.ring"
        ring = RingWriter.create(self.path, 4, PACKED_BYTES, REGISTER_KIND)
        self.serving = Serving(Idle(), ring, LIMITS, 1.5, ManualClock(), simulation=True)  # type: ignore[arg-type]
        self.activation = Activation(self.serving, self.store, calibration.facts)

    def image(self) -> RegisterImage:
        self.serving.publish()
        with RingReader.open(self.path, REGISTER_KIND) as ring:
            message = ring.newest()
        assert message is not None
        return RegisterImage.unpack(message.payload)

    def load(self) -> RegisterImage:
        asyncio.run(self.activation.load_current())
        return self.image()


@pytest.fixture
def calibration() -> Calibration:
    return replace(Samples(1).calibration(), verdict=Verdict())


@pytest.fixture
def bench(tmp_path: Path, calibration: Calibration) -> Bench:
    return Bench(tmp_path, calibration)


def test_the_calibration_in_use_is_served_after_a_start(bench: Bench) -> None:
    assert bench.image().answer.status is Status.STARTING
    stored = bench.store.activate(bench.name)
    image = bench.load()
    assert (image.answer.status, bool(image.state & State.CALIBRATED)) == (Status.IDLE, True)
    assert bench.serving.calibration_id == stored.register_id


def test_a_cell_file_that_changed_since_is_a_mismatch_in_the_registers_with_the_names(
    bench: Bench, calibration: Calibration
) -> None:
    bench.store.activate(bench.name)
    moved = replace(calibration.facts.tool, name="other")
    bench.activation.facts = replace(calibration.facts, tool=moved, robot_sigma_mm=0.77)
    image = bench.load()
    assert image.answer.status is Status.CALIBRATION_MISMATCH
    assert not image.state & State.CALIBRATED
    _, reason = bench.serving.fault() or (None, "")
    assert "tool.name was " in reason
    assert "robot.sigma_mm was " in reason


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: flip(path / "cal-000001.json"), "cal-000001.json: the checksum is wrong"),
        (lambda path: (path / "CURRENT").write_bytes(b""), "CURRENT: the checksum is wrong"),
        (lambda path: (path / "CURRENT").unlink(), "CURRENT is gone; cal-000001"),
        (lambda path: (path / "cal-000001.json").unlink(), "no calibration 'cal-000001'"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_told_with_the_cause(
    bench: Bench, spoil: Callable[[Path], None], words: str
) -> None:
    bench.store.activate(bench.name)
    spoil(bench.store.path)
    assert bench.load().answer.status is Status.NOT_CALIBRATED
    _, reason = bench.serving.fault() or (None, "")
    assert words in reason
    assert "activate" in reason


def test_a_calibration_of_another_cell_is_not_activated_and_the_former_serves_on(
    bench: Bench, calibration: Calibration
) -> None:
    bench.store.activate(bench.name)
    bench.load()
    other = bench.store.save(replace(calibration, facts=replace(calibration.facts, robot_id="x")))
    with pytest.raises(CalibrationMismatch, match=r"robot\.id was x"):
        asyncio.run(bench.activation.activate(other, ""))
    assert bench.store.current_id() == bench.name
    assert bench.serving.calibration is not None
    assert bench.serving.calibration.id == bench.name


def test_a_rejected_calibration_is_not_usable(calibration: Calibration) -> None:
    rejected = replace(calibration, verdict=Verdict((Finding("bad", "too bad", fatal=True),)))
    with pytest.raises(InputError, match="too bad"):
        check_usable(rejected, calibration.facts)


class Publishing:
    """Counts what the serving loop publishes while something else goes on."""

    def __init__(self, bench: Bench) -> None:
        self.ring = bench.serving.ring
        self.loop = bench.serving.run

    async def beside(self, work: asyncio.Task[object], images: int) -> None:
        """Return when so many images came beside `work`; it must not end before."""
        serving = asyncio.create_task(self.loop())
        try:
            goal = self.ring.index + images
            async with asyncio.timeout(LONG_S):
                while self.ring.index < goal:
                    assert not work.done()
                    await asyncio.sleep(0.001)
        finally:
            serving.cancel()


def test_the_registers_live_on_while_another_process_holds_the_lock_of_the_store(
    bench: Bench,
) -> None:
    async def activate() -> object:
        lock = FileLock(bench.store.path / ".lock", thread_local=False)
        with lock:
            work = asyncio.create_task(bench.activation.activate(bench.name, ""))
            await Publishing(bench).beside(work, images=5)
        async with asyncio.timeout(LONG_S):
            return await work

    assert asyncio.run(activate())["calibration"] == bench.name
    assert bench.store.current_id() == bench.name


def test_a_lock_that_is_never_released_is_an_error_in_time_and_nothing_changes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrations, "_LOCK_S", 0.05)
    with (
        FileLock(bench.store.path / ".lock", thread_local=False),
        pytest.raises(StoreError, match="locked by another process"),
    ):
        asyncio.run(bench.activation.activate(bench.name, ""))
    assert bench.serving.calibration is None


class SlowStore:
    """A store whose disk hangs until it is released."""

    def __init__(self, stored: StoredCalibration) -> None:
        self.stored = stored
        self.released = threading.Event()

    def current(self) -> StoredCalibration:
        if not self.released.wait(LONG_S):
            raise StoreError("the disk hangs")
        return self.stored


def test_the_registers_say_starting_while_the_disk_with_the_calibration_hangs(
    bench: Bench,
) -> None:
    slow = SlowStore(bench.store.activate(bench.name))
    bench.activation.store = slow  # type: ignore[assignment]

    async def start() -> Status:
        work = asyncio.create_task(bench.activation.load_current())
        await Publishing(bench).beside(work, images=5)
        before = bench.image().answer.status
        slow.released.set()
        await work
        return before

    assert asyncio.run(start()) is Status.STARTING
    assert bench.image().answer.status is Status.IDLE


def test_the_answer_of_an_activation_is_json(bench: Bench) -> None:
    told = asyncio.run(bench.activation.activate(bench.name, "anna"))
    assert json.loads(json.dumps(told)) == told
    assert bench.store.activations()[-1].by == "anna"
