"""What the daemon said last, and how long ago; commands to it."""

import asyncio
import base64
import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
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
SLOW_PERIOD_S: Final = 1.0  # of what changes slowly
SLOW_REPLY_S: Final = 5.0  # of what is read from files, on a busy computer
STALE_S: Final = 0.8  # what is older is not valid any more; with the page's own delays it is grey within a second
LATE_S: Final = (
    2.0  # after it a press is not obeyed: this server hung, the arm may stand elsewhere
)
COMMAND_S: Final = 30.0  # a sample takes two pictures, of 5 s each at most
SOLVE_S: Final = 300.0  # as `vgrd solve`
REST_S: Final = (
    30.0  # the daemon may hold each question that it does not answer: its clients are counted
)
VIEWED_S: Final = 3.0  # nobody looks at pictures who has not asked for so long
PICTURE_WAIT_S: Final = 1.0  # of one request for another picture

log = structlog.get_logger()
Reply = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as the control socket gives it; facts: all of the reply but the pixels.

    taken_s: when it was taken (`Link.now_s`).
    """

    jpeg: bytes
    facts: Reply
    taken_s: float


@dataclass(frozen=True, slots=True)
class Poll:
    """How one operation is followed.

    period_s: from a reply to the next question; limit_s: for a reply; kept_s: an older reply is not shown;
    rest_s: the longest pause after it hung; viewed: asked only while somebody looks at pictures.
    """

    period_s: float
    limit_s: float
    kept_s: float
    rest_s: float = REST_S
    viewed: bool = False


_SLOW: Final = Poll(SLOW_PERIOD_S, SLOW_REPLY_S, kept_s=8.0)
POLLS: Final[Mapping[str, Poll]] = MappingProxyType(
    {
        # Old registers turn the page grey, and go on at once when they are heard again.
        "registers": Poll(PERIOD_S, REPLY_S, kept_s=math.inf, rest_s=PERIOD_S),
        "teaching": Poll(0.3, 2.0, kept_s=3.0),  # people are slower than robots
        "status": _SLOW,
        "answers": _SLOW,
        "calibrations": _SLOW,
        "result": _SLOW,
        "trials": _SLOW,
        "scene": Poll(0.4, 2.0, kept_s=3.0, viewed=True),  # an arm is jogged slowly
        "diary": Poll(20.0, 10.0, kept_s=60.0),  # goes by the hour
    }
)
_NOTHING: Final[Reply] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Heard:
    """What came of a question: a reply, or the words of its refusal. told_s: when (`Link.now_s`)."""

    told_s: float
    reply: Reply
    refusal: str = ""


class Link:
    """Follows one daemon for every browser together."""

    def __init__(self, runtime_dir: Path, clock: Clock) -> None:
        self._client = ControlClient(runtime_dir / CONTROL_SOCKET)
        self._clock = clock
        self.heard: dict[str, Heard] = {}
        # A thread for each question that may be open, and none of a command: however many of
        # those wait, what is shown stays fresh.
        self._threads = ThreadPoolExecutor(len(POLLS) + 1, "poll")
        self._under_way: dict[str, str] = {}  # commands, by who gave them
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
        heard = self.heard.get("registers")
        if heard is None or heard.refusal:
            return math.inf
        return self.now_s - heard.told_s + float(heard.reply.get("age_s", 0.0))

    @property
    def is_alive(self) -> bool:
        """Whether gate, cell and this process have spoken just now."""
        return self.age_s < STALE_S

    def reply(self, op: str) -> Reply:
        """The newest reply to an operation; empty where there is none that may be shown: `trouble` says why."""
        heard = self.heard.get(op)
        return _NOTHING if heard is None or self._is_old(op, heard) else heard.reply

    def trouble(self, op: str) -> str:
        """Why there is no reply to show, "" where there is one, or nobody wants one."""
        if POLLS[op].viewed and not self._is_viewed:
            return ""
        heard = self.heard.get(op)
        if heard is None:
            return texts.NOT_HEARD
        if self._is_old(op, heard):
            return texts.SILENT.format(seconds=self.now_s - heard.told_s)
        return heard.refusal

    def _is_old(self, op: str, heard: Heard) -> bool:
        return self.now_s - heard.told_s > POLLS[op].kept_s

    async def follow(self) -> None:
        """Ask again and again, once, until cancelled; no question is open when it ends."""
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._follow_pictures())
                for op, poll in POLLS.items():
                    tasks.create_task(self._follow(op, poll))
        finally:
            await asyncio.to_thread(self._threads.shutdown, cancel_futures=True)

    async def command(
        self, op: str, who: str, pressed_s: float | None = None, **arguments: object
    ) -> Reply:
        """Give a command; ControlError with words where it is refused, where it is late, where there is no link.

        pressed_s: when a button was pressed, None where that does not matter. Of commands by one `who`
        only one is under way: the next is refused until that one is done.
        """
        if not self.is_alive:
            raise DaemonUnreachable("there is no link to the daemon, so nothing was sent")
        late_s = 0.0 if pressed_s is None else self.now_s - pressed_s
        if not late_s <= LATE_S:  # nor what is no number
            raise ControlError(texts.LATE.format(seconds=late_s))
        if who in self._under_way:
            raise ControlError(texts.STILL_BUSY.format(what=self._under_way[who]))
        limit_s = SOLVE_S if op == "solve" else COMMAND_S
        log.info("command", op=op, who=who, **arguments)
        self._under_way[who] = op
        try:
            return await self._call(op, limit_s, **arguments)
        except ControlError as refusal:
            log.warning("command_refused", op=op, who=who, reason=str(refusal))
            raise
        finally:
            del self._under_way[who]

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

    async def _follow(self, op: str, poll: Poll) -> None:
        """Ask one operation again and again: more and more rarely while it hangs, and not while the cell does."""
        pause_s = poll.period_s
        while True:
            if self._is_wanted(op, poll):
                is_answered = await self._hear(op, poll.limit_s)
                pause_s = poll.period_s if is_answered else min(2 * pause_s, poll.rest_s)
            await asyncio.sleep(min(pause_s, SLOW_PERIOD_S) if op not in self.heard else pause_s)

    def _is_wanted(self, op: str, poll: Poll) -> bool:
        return (op == "registers" or self.is_alive) and (self._is_viewed or not poll.viewed)

    async def _hear(self, op: str, limit_s: float) -> bool:
        """Ask once; False where nobody answers in time: what was heard before ages.

        After a refusal it is not so any more: the words of the refusal take its place.
        """
        reply, words = _NOTHING, ""
        try:
            reply = await self._poll(op, limit_s)
        except DaemonUnreachable:
            return False
        except ControlError as refusal:
            words = str(refusal)
        self.heard[op] = Heard(self.now_s, reply, words)
        return True

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
        wait_s = PICTURE_WAIT_S
        reply = dict(await self._poll("picture", REPLY_S + wait_s, after=last, wait_s=wait_s))
        if reply["frame"] != last:
            jpeg, taken_s = base64.b64decode(reply.pop("jpeg")), self.now_s - reply["age_s"]
            self.picture = Picture(jpeg, reply, taken_s)
            self._new_picture.set()

    async def _poll(self, op: str, timeout_s: float, **arguments: object) -> Reply:
        """Ask for what is shown."""
        call = partial(self._client.call, op, timeout_s=timeout_s, **arguments)
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    async def _call(self, op: str, timeout_s: float, **arguments: object) -> Reply:
        """Ask for what a person wants."""
        return await asyncio.to_thread(self._client.call, op, timeout_s=timeout_s, **arguments)
