"""Who looks at a page, and the commands that the buttons there give."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import structlog
from nicegui import ui

from vgrd.errors import ControlError
from vgrd.page import texts
from vgrd.page.access.guard import Guard
from vgrd.page.link import Link, Reply

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Seen:
    """What a button was pressed at: the version that its page showed, and when (the clock of `Link`).

    shown: what stood there of `vgrd.page.shown`, by key.
    """

    version: str
    at_s: float
    shown: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, sent: object) -> "Seen":
        """As `assets/watchdog.js` writes it; what cannot be read is of no version and of long ago."""
        try:
            version, at_ms, shown = json.loads(str(sent))
            texts_shown = {str(key): str(words) for key, words in shown.items()}
            return cls(str(version), float(at_ms) / 1e3, texts_shown)
        except (ValueError, TypeError, AttributeError):
            return cls("unknown", 0.0)

    def __getitem__(self, key: str) -> str:
        """What stood there; "" for what did not, which no command takes for a name."""
        return self.shown.get(key, "")


@dataclass(frozen=True, slots=True)
class Visitor:
    """One browser. guard: lets it command or not, None where all may; mark: by which the guard knows it."""

    link: Link
    address: str
    guard: Guard | None = None
    mark: str = field(default="", repr=False)

    @property
    def who(self) -> str:
        """Is written into the log beside every command: the address, and the session where there is one."""
        session = "" if self.guard is None else self.guard.name(self.mark)
        return f"{self.address} {session}".strip()

    async def command(self, op: str, seen: Seen, **arguments: object) -> Reply | None:
        """Give a command as of what was seen; None where it was refused, which is told."""
        return await self._told(op, seen.at_s, version=seen.version, **arguments)

    async def solve(self, session: str) -> Reply | None:
        """Solve a session: that changes nothing that a version names, and comes never too late."""
        return await self._told("solve", None, session=session)

    async def ask(self, op: str, **arguments: object) -> Reply | None:
        """What an operation tells that changes nothing; None where it was refused, which is told."""
        try:
            return await self.link.ask(op, **arguments)
        except ControlError as refusal:
            ui.notify(texts.REFUSED.format(reason=refusal), type="warning", multi_line=True)
            return None

    async def _told(self, op: str, pressed_s: float | None, **arguments: object) -> Reply | None:
        """Give a command, if this browser may, and say what became of it."""
        try:
            self._check(op)
            reply = await self.link.command(op, self.who, pressed_s, **arguments)
        except ControlError as refusal:
            ui.notify(
                texts.REFUSED.format(reason=refusal), type="warning", timeout=8000, multi_line=True
            )
            return None
        words = texts.RECORDED if "sample" in reply else texts.DID
        ui.notify(words.format(what=op, sample=reply.get("sample")), timeout=2500)
        return reply

    def _check(self, op: str) -> None:
        try:
            if self.guard is not None:
                self.guard.check(self.mark)
        except ControlError as refusal:
            log.warning("command_refused", op=op, who=self.who, reason=str(refusal))
            raise
