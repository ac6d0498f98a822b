"""Who may command: a session for each browser that gave the password, and how often one may guess it."""

import asyncio
import hashlib
import math
import secrets
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import structlog

from vgrd.clock import Clock
from vgrd.errors import ControlError, InputError
from vgrd.page import texts
from vgrd.page.access.buckets import Buckets
from vgrd.page.access.password import Password

IDLE_S: Final = 15 * 60.0  # without a command: who went away is not at the cell any more
LONGEST_S: Final = 8 * 3600.0  # a shift
FREE_MISSES: Final = 5
FIRST_WAIT_S: Final = 10.0
LONGEST_WAIT_S: Final = 300.0
FORGET_S: Final = 3600.0  # an address that does not try for so long starts anew
ALL_MISSES: Final = 30  # of all addresses together, and then one each ALL_WAIT_S
ALL_WAIT_S: Final = 10.0
_MOST_ADDRESSES: Final = 4096
_THREADS: Final = 2  # that hash at once; more tries wait in line, and the lock-out bounds them

log = structlog.get_logger()


@dataclass(slots=True)
class Session:
    """Of one browser. id: for the log, of no use to who reads it; begun_s, used_s: by the monotonic clock."""

    id: str
    begun_s: float
    used_s: float

    def ends_s(self) -> float:
        """When it ends unless there is another command."""
        return min(self.used_s + IDLE_S, self.begun_s + LONGEST_S)


class Sessions:
    """By the hash of the mark that each browser keeps as its cookie; they live as long as this process."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._sessions: dict[bytes, Session] = {}

    def begin(self, mark: str) -> Session:
        """A new session, in the place of an old one."""
        now_s = self._clock.monotonic()
        self._sessions = {k: one for k, one in self._sessions.items() if now_s < one.ends_s()}
        session = Session(secrets.token_hex(4), now_s, now_s)
        self._sessions[_hash(mark)] = session
        return session

    def find(self, mark: str) -> Session | None:
        """The session of a browser, None where there is none or it is over."""
        session = self._sessions.get(_hash(mark))
        return session if session and self._clock.monotonic() < session.ends_s() else None

    def use(self, mark: str) -> Session | None:
        """As `find`, and what happens now is a command."""
        session = self.find(mark)
        if session is not None:
            session.used_s = self._clock.monotonic()
        return session

    def end(self, mark: str) -> None:
        """Nothing happens where there is none."""
        self._sessions.pop(_hash(mark), None)


def _hash(mark: str) -> bytes:
    """Marks have 256 random bits, so that no salt is needed."""
    return hashlib.sha256(mark.encode()).digest()


class LockOut:
    """How long an address must wait before it may try a password again."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._misses: OrderedDict[str, tuple[int, float]] = OrderedDict()  # how many, last when
        self._all = Buckets(clock, 1.0 / ALL_WAIT_S, ALL_MISSES)

    def wait_s(self, address: str) -> float:
        """0 where it may try now."""
        count, last_s = self._of(address)
        wait_s = 0.0
        if count >= FREE_MISSES:
            wait_s = min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(20, count - FREE_MISSES))
        left_s = last_s + wait_s - self._clock.monotonic()
        return max(0.0, left_s, self._all.wait_s(""))

    def count(self, address: str) -> None:
        """A try is a miss until `forgive`, so that many at once are no way around."""
        self._all.take("")
        self._misses[address] = (self._of(address)[0] + 1, self._clock.monotonic())
        self._misses.move_to_end(address)
        if len(self._misses) > _MOST_ADDRESSES:
            self._misses.popitem(last=False)

    def forgive(self, address: str) -> None:
        """It was the password."""
        self._all.give_back("")
        self._misses.pop(address, None)

    def _of(self, address: str) -> tuple[int, float]:
        now_s = self._clock.monotonic()
        count, last_s = self._misses.get(address, (0, now_s))
        return (count, last_s) if now_s - last_s < FORGET_S else (0, now_s)


class Guard:
    """Of one page process. Refusals are ControlErrors, in words for the person at the page.

    The password file is read anew at each log-in; a new password ends the sessions of the old one.
    Raises InputError where the file is not good at the start.
    """

    def __init__(self, password_file: Path, clock: Clock) -> None:
        self._file, self._clock = password_file, clock
        self._password = Password.read(password_file)
        self._sessions, self._lock_out = Sessions(clock), LockOut(clock)
        self._threads = ThreadPoolExecutor(_THREADS, "scrypt")

    async def log_in(self, mark: str, address: str, word: str) -> None:
        """Begin a session where the password is right, ControlError where it is not or must wait."""
        wait_s = self._lock_out.wait_s(address)
        if wait_s > 0.0:
            log.warning("log_in_locked", address=address, wait_s=math.ceil(wait_s))
            raise ControlError(texts.LOCKED.format(seconds=math.ceil(wait_s)))
        self._lock_out.count(address)
        loop = asyncio.get_running_loop()
        try:
            password, fits = await loop.run_in_executor(self._threads, self._try, word)
        except InputError as error:
            log.error("no_password", reason=str(error))  # noqa: TRY400  a line, not a trace
            raise ControlError(texts.NO_PASSWORD) from error
        if password != self._password:
            self._password, self._sessions = password, Sessions(self._clock)
        if not fits:
            log.warning("wrong_password", address=address)
            raise ControlError(texts.WRONG_PASSWORD)
        self._lock_out.forgive(address)
        session = self._sessions.begin(mark)
        log.info("logged_in", address=address, session=session.id)

    def _try(self, word: str) -> tuple[Password, bool]:
        password = Password.read(self._file)
        return password, password.fits(word)

    def log_out(self, mark: str, address: str) -> None:
        """End the session of this browser, in all its windows."""
        session = self._sessions.find(mark)
        self._sessions.end(mark)
        if session is not None:
            log.info("logged_out", address=address, session=session.id)

    def check(self, mark: str) -> None:
        """Before every command; ControlError where this browser has no session."""
        if self._sessions.use(mark) is None:
            raise ControlError(texts.NOT_LOGGED_IN)

    def name(self, mark: str) -> str:
        """The session's id for the log, empty without one."""
        session = self._sessions.find(mark)
        return "" if session is None else session.id

    def left_s(self, mark: str) -> float | None:
        """Until the session ends if there is no command, None without one."""
        session = self._sessions.find(mark)
        return None if session is None else session.ends_s() - self._clock.monotonic()
