"""Presses become touches of the next target; what is no press of now becomes none."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.cell.recording.pedal import FootTouches
from vgrd.devices import wire
from vgrd.errors import ControlError, NotSteady
from vgrd.ipc.ring import RingWriter
from vgrd.model import Plan
from vgrd.store.sessions import SampleKind, SessionWriter, load_session

INPUT = 5


class Bench:
    """`FootTouches` over a teaching that stores at once; `refusal` is what it says instead."""

    def __init__(self, folder: Path) -> None:
        self.samples, self.clock = Samples(3), ManualClock()
        self.facts = self.samples.facts()
        self.refusal: Exception | None = None
        self.question = ""
        self.recorder = self
        self.writer: SessionWriter | None = SessionWriter(
            folder, "s", Plan.JOINT, self.facts, self.clock
        )
        self.ring = RingWriter.create(
            folder / wire.PEDAL_RING, wire.PEDAL_SLOTS, wire.PEDAL_BYTES, wire.PEDAL_KIND
        )
        self.feet = FootTouches(self, folder, self.clock, INPUT)  # type: ignore[arg-type]

    def open_session(self) -> SessionWriter:
        if self.writer is None:
            raise ControlError("no session is being recorded")
        return self.writer

    async def touch(
        self, target: str, kind: SampleKind, *, by_foot: bool = False
    ) -> dict[str, object]:
        if self.refusal is not None:
            raise self.refusal
        touch = self.samples.touch(target)
        number = self.open_session().sample(kind, touch, by_foot=by_foot)
        return {
            "sample": number,
            "questions": {str(number): self.question} if self.question else {},
        }

    def press(self, stamp_s: float | None = None) -> None:
        self.ring.publish(stamp_s=self.clock.now_s if stamp_s is None else stamp_s)

    def inputs(self, *bits: int) -> None:
        for value in bits:
            reading = replace(self.samples.flange(self.clock.now_s), digital_inputs=value)
            self.feet.on_readings([reading])

    def last(self, *acts: Callable[[], None]) -> object:
        """What the pedal says last after these acts, each followed by time for it."""

        async def live() -> None:
            task = asyncio.create_task(self.feet.run())
            for act in acts:
                act()
                await asyncio.sleep(0.3)
            task.cancel()

        asyncio.run(live())
        return self.feet.status()["last"]


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path)
    yield bench
    bench.ring.close()
    if bench.writer is not None:
        bench.writer.close()


def test_presses_touch_one_target_after_the_other_and_an_undone_one_again(bench):
    first, second = list(bench.facts.object.targets)[:2]
    assert bench.last(bench.press) == f"{first}: sample 1"
    assert str(bench.last(bench.press)).startswith(f"{second}: ")
    bench.writer.undo()
    assert str(bench.last(bench.press)).startswith(f"{second}: ")


def test_a_touch_by_foot_that_is_questioned_says_so_in_the_status(bench):
    bench.question = "the touches so far put the tip 30 mm from it"
    first = next(iter(bench.facts.object.targets))
    assert bench.last(bench.press) == f"{first}: sample 1: {bench.question}"


def test_an_input_of_the_robot_is_a_press_where_it_comes_on_and_only_the_one_that_was_chosen(
    bench,
):
    on = 1 << INPUT
    assert bench.last(lambda: bench.inputs(on, on, 0)) is None
    assert bench.last(lambda: bench.inputs(on << 1, 0)) is None
    first = next(iter(bench.facts.object.targets))
    assert bench.last(lambda: bench.inputs(on, on, on)) == f"{first}: sample 1"
    assert bench.writer.counts[SampleKind.TOUCH] == 1


def test_a_press_from_before_this_process_is_none(bench):
    assert bench.last(lambda: bench.press(bench.clock.now_s - 5.0)) is None


def test_after_a_press_that_was_not_recorded_the_pedal_waits_for_a_name(bench):
    """Else every later touch would have the name of the one before it."""
    first, second = list(bench.facts.object.targets)[:2]
    bench.refusal = NotSteady("the robot moved")
    assert bench.last(bench.press) == f"{first}: not recorded: the robot moved"
    bench.refusal = None
    assert f"touch {first} by its name first" in str(bench.last(bench.press))
    assert bench.writer.counts[SampleKind.TOUCH] == 0
    asyncio.run(bench.touch(first, SampleKind.TOUCH))
    assert str(bench.last(bench.press)).startswith(f"{second}: sample")
    bench.writer.close()
    bench.writer = None
    assert "no session" in str(bench.last(bench.press))


def test_the_session_tells_the_last_target_that_nobody_named(bench, tmp_path):
    first, second = list(bench.facts.object.targets)[:2]
    bench.last(bench.press)
    asyncio.run(bench.touch("P1" if first != "P1" else first, SampleKind.TOUCH))
    folder = bench.writer.path
    assert load_session(folder).last_by_foot == first
    bench.writer.undo()
    bench.writer.undo()
    assert load_session(folder).last_by_foot is None
    assert second


def test_a_press_that_was_missed_in_one_session_does_not_stop_the_next_one(bench, tmp_path):
    first = next(iter(bench.facts.object.targets))
    bench.refusal = NotSteady("the robot moved")
    bench.last(bench.press)
    bench.refusal = None
    bench.writer.close()
    bench.writer = SessionWriter(tmp_path, "t", Plan.JOINT, bench.facts, bench.clock)
    assert bench.last(bench.press) == f"{first}: sample 1"
