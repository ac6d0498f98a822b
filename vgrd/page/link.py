"""What the daemon said last, and how long ago; commands to it."""

import asyncio
import base64
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import structlog

from vgrd.clock import Clock
from vgrd.errors import ControlError, DaemonUnreachable
from vgrd.ipc.control import ControlClient
from vgrd.page import texts

CONTROL_SOCKET: Final = "control.sock"  # as `vgrd.config.setup`
PERIOD_S: Final = (
    0.15  # from one look at the registers to the next: the page may be a second behind at most
)
REPLY_S: Final = 0.7  # a cell that is silent for longer is shown as none
TEACHING_PERIOD_S: Final = 0.3  # of the wizard: people are slower than robots
SLOW_PERIOD_S: Final = 1.0  # of what changes slowly
STALE_S: Final = 0.8  # what is older is not valid any more; with the page's own delays it is grey within a second
LATE_S: Final = (
    2.0  # after it a press is not obeyed: this server hung, the arm may stand elsewhere
)
COMMAND_S: Final = 30.0  # a sample takes two pictures, of 5 s each at most
SOLVE_S: Final = 300.0  # as `vgrd solve`
SCENE_PERIOD_S: Final = 0.4  # of the drawing of the cell: an arm is jogged slowly
DIARY_PERIOD_S: Final = 20.0  # of what goes by the hour
VIEWED_S: Final = 3.0  # nobody looks at pictures who has not asked for so long
PICTURE_WAIT_S: Final = 1.0  # of one request for another picture

log = structlog.get_logger()
Reply = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as the control socket gives it; facts: all of the reply but the pixels."""

    jpeg: bytes
    facts: Reply


@dataclass(slots=True)
class Heard:
    """Newest replies by operation; told_s: when the registers were told (`Link.now_s`)."""

    replies: dict[str, Reply] = field(default_factory=dict)
    told_s: float = -1e9


class Link:
    """Follows one daemon for every browser together."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self._client = ControlClient(runtime_dir / CONTROL_SOCKET)
        self._clock = clock
        self.heard = Heard()
        self.picture: Picture | None = None
        self._new_picture, self._asking = asyncio.Event(), asyncio.Lock()
        self._viewed_s = -1e9

    @property
    def now_s(self) -> float:
        """The clock by which presses are dated."""
        return self._clock.monotonic()

    @property
    def age_s(self) -> float:
        """How old the newest registers are, as the gate told them to the cell and the cell to us."""
        since_s = self._clock.monotonic() - self.heard.told_s
        return since_s + float(self.reply("registers").get("age_s", 0.0))

    @property
    def is_alive(self) -> bool:
        """Whether gate, cell and this process have spoken just now."""
        return self.age_s < STALE_S

    def reply(self, op: str) -> Reply:
        """The newest reply to an operation, empty before the first."""
        return self.heard.replies.get(op, {})

    async def follow(self) -> None:
        """Ask again and again, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._follow_state())
            tasks.create_task(self._follow("teaching", TEACHING_PERIOD_S, REPLY_S))
            tasks.create_task(self._follow_slowly())
            tasks.create_task(self._follow_pictures())
            tasks.create_task(self._follow_scene())
            tasks.create_task(self._follow("diary", DIARY_PERIOD_S))

    async def command(
        self, op: str, who: str, pressed_s: float | None = None, **arguments: object
    ) -> Reply:
        """Give a command; ControlError with words where it is refused, where it is late, where there is no link.

        pressed_s: when a button was pressed, None where that does not matter.
        """
        if not self.is_alive:
            raise DaemonUnreachable("there is no link to the daemon, so nothing was sent")
        late_s = 0.0 if pressed_s is None else self.now_s - pressed_s
        if late_s > LATE_S:
            raise ControlError(texts.LATE.format(seconds=late_s))
        limit_s = SOLVE_S if op == "solve" else COMMAND_S
        log.info("command", op=op, who=who, **arguments)
        try:
            reply = await self._call(op, limit_s, **arguments)
        except ControlError as refusal:
            log.warning("command_refused", op=op, who=who, reason=str(refusal))
            raise
        return reply

    async def ask(self, op: str, **arguments: object) -> Reply:
        """What an operation tells that changes nothing; one after the other, for they cost the cell some time."""
        async with self._asking:
            return await self._call(op, COMMAND_S, **arguments)

    @property
    def _is_viewed(self) -> bool:
        """Whether a browser has asked for pictures just now."""
        return self._clock.monotonic() - self._viewed_s <= VIEWED_S

    async def newest_picture(self, after: int) -> Picture | None:
        """A picture with another number, None where none comes within a second."""
        self._viewed_s = self._clock.monotonic()
        if self.picture is None or self.picture.facts["frame"] == after:
            self._new_picture.clear()
            try:
                async with asyncio.timeout(PICTURE_WAIT_S):
                    await self._new_picture.wait()
            except TimeoutError:
                return None
        return self.picture

    async def _follow_state(self) -> None:
        while True:
            with suppress(ControlError):  # what was heard before ages, and that is shown
                self.heard.replies["registers"] = await self._call("registers", REPLY_S)
                self.heard.told_s = self.now_s
            await asyncio.sleep(PERIOD_S)

    async def _follow_slowly(self) -> None:
        while True:
            for op in ("status", "answers", "calibrations", "result", "trials"):
                with suppress(ControlError):  # idem
                    self.heard.replies[op] = await self._call(op, COMMAND_S)
            await asyncio.sleep(SLOW_PERIOD_S)

    async def _follow(self, op: str, period_s: float, timeout_s: float = COMMAND_S) -> None:
        """Ask one operation again and again."""
        while True:
            with suppress(ControlError):  # idem
                self.heard.replies[op] = await self._call(op, timeout_s)
            await asyncio.sleep(period_s)

    async def _follow_scene(self) -> None:
        """Where things stand, while somebody looks at pictures: the drawing stands beside one."""
        while True:
            if self._is_viewed:
                with suppress(ControlError):  # idem
                    self.heard.replies["scene"] = await self._call("scene", COMMAND_S)
            await asyncio.sleep(SCENE_PERIOD_S)

    async def _follow_pictures(self) -> None:
        """Fetch pictures once for all browsers, while one of them looks."""
        while True:
            if not self._is_viewed:
                await asyncio.sleep(PERIOD_S)
                continue
            try:
                await self._fetch()
            except ControlError:
                self.picture = None
                await asyncio.sleep(SLOW_PERIOD_S)

    async def _fetch(self) -> None:
        last = None if self.picture is None else self.picture.facts["frame"]
        reply = dict(
            await self._call(
                "picture", REPLY_S + PICTURE_WAIT_S, after=last, wait_s=PICTURE_WAIT_S
            )
        )
        if reply["frame"] != last:
            self.picture = Picture(base64.b64decode(reply.pop("jpeg")), reply)
            self._new_picture.set()

    async def _call(self, op: str, timeout_s: float, **arguments: object) -> Reply:
        return await asyncio.to_thread(self._client.call, op, timeout_s=timeout_s, **arguments)
