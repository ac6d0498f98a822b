"""Touches by foot: a press of a pedal, or of a robot's digital input, records the next target.

Both hands hold the robot while a tip is put onto a target. The next target is the one with the fewest touches
in the open session, in the order of the cell file; so `vgrd touch` and `vgrd undo` have their say.

The foot gets no answer, and one press too many or too few gives every later touch a wrong name, which CAD cannot
tell on a ring of holes. So a rest of the arm is one touch, a press that was not recorded stops the pedal
until a touch is named, and such a session wants `vgrd verify NAME` at its last target.
"""

import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import structlog

from vgrd.cell.feeds import RingFeed
from vgrd.cell.recording.teaching import Teaching
from vgrd.clock import Clock
from vgrd.devices import FlangeReading, wire
from vgrd.errors import ControlError, VgrdError
from vgrd.store.sessions import SampleKind, SessionWriter

LOOK_S = 0.05  # nobody notices so late a reaction of a foot's press

log = structlog.get_logger()


class FootTouches:
    """Turns presses into touches, one after the other; what was pressed meanwhile is dropped.

    robot_input: number of the robot's digital input that counts as a pedal, None for none.
    """

    def __init__(
        self, teaching: Teaching, runtime_dir: Path, clock: Clock, robot_input: int | None
    ) -> None:
        self.teaching = teaching
        self.robot_input = robot_input
        self._pedal = RingFeed(runtime_dir / wire.PEDAL_RING, wire.PEDAL_KIND, clock)
        self._since_s = clock.monotonic()
        self._clock = clock
        self._is_down: bool | None = None
        self._is_wanted = False
        self._last = ""
        self._missed: tuple[SessionWriter, str, int] | None = None  # target, how many touches then

    def on_readings(self, readings: Sequence[FlangeReading]) -> None:
        """Watch the robot's input: a press is where it comes on; one that is on at first was not pressed."""
        if self.robot_input is None:
            return
        for reading in readings:
            is_down = bool(reading.digital_inputs >> self.robot_input & 1)
            self._is_wanted |= is_down and self._is_down is False
            self._is_down = is_down

    async def run(self) -> None:
        """Record a touch at each press, until cancelled."""
        while True:
            if self._pressed():
                await self._touch()
                self._pressed()
            await asyncio.sleep(LOOK_S)

    def status(self) -> Mapping[str, Any]:
        """What the last press led to, for `vgrd status`."""
        return {"last": self._last or None}

    def _pressed(self) -> bool:
        """Whether there was a press since the last call; one for an earlier life of this process is none."""
        fresh = [one for one in self._pedal.poll() if one.stamp_s >= self._since_s]
        wanted, self._is_wanted = self._is_wanted, False
        return wanted or bool(fresh)

    async def _touch(self) -> None:
        name = ""
        try:
            session = self.teaching.recorder.open_session()
            name, count = self._next_target(session)
            if self._missed == (session, name, count):
                raise ControlError(f"touch {name} by its name first: vgrd touch")
            self._missed = (session, name, count)
            reply = await self.teaching.touch(name, SampleKind.TOUCH, by_foot=True)
            self._missed = None
        except VgrdError as err:
            self._last = f"{name or 'no target'}: not recorded: {err}"
            log.warning("pedal_not_recorded", target=name, reason=str(err))
        else:
            asked = reply.get("questions")
            question = asked.get(str(reply["sample"]), "") if isinstance(asked, Mapping) else ""
            self._last = f"{name}: sample {reply['sample']}" + (
                f": {question}" if question else ""
            )
            log.info("pedal_touch", target=name, sample=reply["sample"], question=question)

    def _next_target(self, session: SessionWriter) -> tuple[str, int]:
        """Its name, and how many touches there are."""
        touched = session.touched
        name = min(self.teaching.facts.object.targets, key=lambda name: touched[name])
        return name, touched.total()
