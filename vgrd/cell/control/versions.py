"""Commands of people who see the same cell: each is taken only if what its giver saw is still so."""

import asyncio
import secrets
import zlib
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from vgrd.cell.control.lines import Arguments, optional_text
from vgrd.cell.control.server import Operation
from vgrd.cell.recording.teaching import Teaching
from vgrd.cell.serving.service import Serving
from vgrd.cell.serving.trials import Trials
from vgrd.errors import StaleVersion
from vgrd.model import Touch

_BOOT_BYTES = 3  # tells two lives of the cell apart


class Versions:
    """Names the state of session, calibration, its verifications and a latched fault; lets commands through by turns.

    What is harvested changes no version: a rest of the arm shall not make a press of a button stale.
    """

    def __init__(self, teaching: Teaching, serving: Serving, trials: Trials) -> None:
        self._teaching, self._serving, self._trials = teaching, serving, trials
        self._boot = secrets.token_hex(_BOOT_BYTES)
        self._turn = asyncio.Lock()

    @property
    def now(self) -> str:
        """The present version: another one with every change, the same where nothing has changed."""
        writer, calibration = self._teaching.recorder.writer, self._serving.calibration
        session = "" if writer is None else writer.header.name
        samples = () if writer is None else writer.taught
        asked = [
            (
                one.sequence,
                one.kind.value,
                one.value.target if isinstance(one.value, Touch) else "",
            )
            for one in samples
            if not one.harvested
        ]
        name = None if calibration is None else calibration.id
        # A fault that waits for a person, too: whoever confirms has read which one it is.
        state = (session, asked, name, self._trials.changes, self._serving.faults.latched)
        return f"{self._boot}-{zlib.crc32(repr(state).encode()):08x}"

    def guarded(
        self, perform: Callable[[Arguments], Awaitable[Mapping[str, Any]]], *arguments: str
    ) -> Operation:
        """An operation that changes something: it may name the version that its giver saw.

        Those that do wait for each other, so of two that saw the same only one is obeyed.
        """

        async def checked(given: Arguments) -> Mapping[str, Any]:
            seen = optional_text(given, "version")
            if seen is None:
                return await perform(given)
            async with self._turn:
                if seen != self.now:
                    raise StaleVersion(
                        "not done: somebody did something else since this was shown, or the cell "
                        "was started anew: look at what is there now, and ask again"
                    )
                return {**await perform(given), "version": self.now}

        return Operation(checked, (*arguments, "version"))
