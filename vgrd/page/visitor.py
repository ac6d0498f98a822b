"""Who looks at a page, and the commands that the buttons there give."""

import json
from collections.abc import Awaitable
from dataclasses import dataclass

from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.link import Link, Reply


@dataclass(frozen=True, slots=True)
class Seen:
    """What a button was pressed at: the version that its page showed, and when (the clock of `Link`)."""

    version: str
    at_s: float

    @classmethod
    def of(cls, sent: object) -> "Seen":
        """As `assets/watchdog.js` writes it; what cannot be read is of no version and of long ago."""
        try:
            version, at_ms = json.loads(str(sent))
            return cls(str(version), float(at_ms) / 1e3)
        except (ValueError, TypeError):
            return cls("unknown", 0.0)


@dataclass(frozen=True, slots=True)
class Visitor:
    """One browser; `who` is written into the log beside every command."""

    link: Link
    who: str

    async def command(self, op: str, seen: Seen, **arguments: object) -> Reply | None:
        """Give a command as of what was seen; None where it was refused, which is told."""
        return await self._told(
            op, self.link.command(op, self.who, seen.at_s, version=seen.version, **arguments)
        )

    async def solve(self, session: str) -> Reply | None:
        """Solve a session: that changes nothing that a version names, and comes never too late."""
        return await self._told("solve", self.link.command("solve", self.who, session=session))

    async def _told(self, op: str, commanded: Awaitable[Reply]) -> Reply | None:
        """Say what became of a command."""
        try:
            reply = await commanded
        except ControlError as refusal:
            ui.notify(
                texts.REFUSED.format(reason=refusal), type="warning", timeout=8000, multi_line=True
            )
            return None
        words = texts.RECORDED if "sample" in reply else texts.DID
        ui.notify(words.format(what=op, sample=reply.get("sample")), timeout=2500)
        return reply
