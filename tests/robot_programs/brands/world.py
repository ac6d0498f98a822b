"""A cell that goes by stepped time: a daemon that answers, an arm that goes straight, an operator with one key."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

ANSWER_AFTER_S = 0.3  # as a fresh picture takes
LEG_S = 1.2
TICK_S = 0.025
LONGEST_S = 200.0  # no program of ours goes on for so long
TAUGHT = (
    500.0,
    0.0,
    200.0,
    180.0,
    0.0,
    0.0,
)  # mm, deg: roll, pitch, yaw of a flange that looks down
SERVED = (512.35, -18.02, 205.10, 179.0, 1.0, -10.0)


class StoppedError(Exception):
    """The program waits for its operator, who has gone home."""


@dataclass(frozen=True)
class Reading:
    """What the daemon says of a request; `link`: whether anything comes at all."""

    trig: int
    status: int
    beat: int
    point: int
    object: int
    pose: tuple[float, ...]
    mapver: int = 0x0100
    echo: int | None = None
    age_ms: int = 150
    u95_um: int = 310
    format: int = 1
    seq: int = 8
    block_status: int | None = None
    block_seq: int | None = None
    block_echo: int | None = None
    link: bool = True

    @property
    def good(self) -> bool:
        return self.status in (1, 2)


@dataclass(frozen=True)
class Ask:
    """A request as it came over the wire."""

    trig: int
    point: int
    command: int
    options: int
    at_s: float


@dataclass(frozen=True)
class Fault:
    """From when on what is read is not the truth.

    since: "ask", from the first request; "approach", "last", 0.3 s after the first or second leg began; "second", from
    the second request on; "recovered": the first request only; "answered": once a good answer was read.
    unreachable: "low", where the point is, "high", where its approach point is, or "low high".
    off: mm from where a leg was sent to where it ends, for whatever reason.
    link: "refused" when it is opened, or "closed" by the peer. garble: what becomes of the line on its way.
    """

    change: Callable[[Reading], Reading] = lambda reading: reading
    since: str = "ask"
    unreachable: str = ""
    off: tuple[float, float, float] = (0.0, 0.0, 0.0)
    link: str = ""
    task_dies: bool = False
    task_restarts: bool = False
    garble: Callable[[str], str] = lambda line: line


@dataclass
class World:
    """Time, the daemon, the arm. `background` is what the controller's other task does each `period_s`.

    restart: what that task does first, when it is started, or started anew.
    asked_before: how often the arm's task had the other one ask, before the controller was started anew.
    visits: how often the arm goes there, a minute of silence between. closing: what ends the connections.
    """

    fault: Fault = field(default_factory=Fault)
    keys: int = 0
    first_trig: int = 0
    asked_before: int = 0
    began_s: float = 100.0
    now_s: float = 100.0
    asks: list[Ask] = field(default_factory=list)
    moves: list[tuple[str, tuple[float, ...]]] = field(default_factory=list)
    stands_at: tuple[float, ...] = TAUGHT[:3]
    legs: int = 0
    leg_began_s: float = math.inf
    lost_s: float = math.inf
    stopped_s: float = math.inf
    told: list[str] = field(default_factory=list)
    visits: int = 1
    closing: list[Callable[[], None]] = field(default_factory=list)
    background: Callable[[], None] = lambda: None
    restart: Callable[[], None] = lambda: None
    period_s: float = 0.05
    decides_within_s: float = 0.03
    _restarted: bool = False
    _next_s: float = 0.0
    _frozen_beat: int | None = None
    _answered_s: float = math.inf

    def advance(self, seconds: float) -> None:
        """Let time pass, and the background task do its turns."""
        end_s = self.now_s + seconds
        assert end_s < self.began_s + LONGEST_S, "the program goes on and on"
        while self.now_s < end_s - 1e-9:
            self.now_s = min(self.now_s + TICK_S, end_s)
            if self.fault.task_restarts and self._faulty() and not self._restarted:
                self._restarted, self.lost_s = True, self.now_s
                self.restart()
            if self.fault.task_dies and self._faulty():
                self.lost_s = min(self.lost_s, self.now_s)
            elif self.now_s >= self._next_s - 1e-9:
                self._next_s = math.inf  # the task does not begin a turn within a turn
                self.background()
                self._next_s = self.now_s + self.period_s

    def wait(self, holds: Callable[[], bool], limit_s: float) -> bool:
        """Wait until something holds; return whether it did in time."""
        end_s = self.now_s + limit_s
        while not holds():
            if self.now_s >= end_s:
                return False
            self.advance(TICK_S)
        return True

    def ask(self, trig: int, point: int, command: int, options: int) -> None:
        """Take a request, or the repetition of one."""
        if not self.asks or self.asks[-1].trig != trig:
            self.asks.append(Ask(trig, point, command, options, self.now_s))

    def read(self) -> Reading:
        """Return what the daemon says now of the last request."""
        beat = int(self.now_s * 10)
        if not self.asks:
            return Reading(0, 0, beat, 0, 0, (math.nan,) * 6)
        ask = self.asks[-1]
        busy = self.now_s < ask.at_s + ANSWER_AFTER_S
        reading = Reading(ask.trig, 10 if busy else 1, beat, ask.point, 0, SERVED)
        faulty = self._faulty()
        if reading.good:
            self._answered_s = min(self._answered_s, self.now_s)
        if not faulty:
            return reading
        self.lost_s = min(self.lost_s, self.now_s)
        changed = self.fault.change(reading)
        if changed.beat < 0:
            self._frozen_beat = self._frozen_beat if self._frozen_beat is not None else beat
            changed = replace(changed, beat=self._frozen_beat)
        return changed

    def go(
        self, place: tuple[float, ...], lost: Callable[[], bool] | None = None, *, way: str = ""
    ) -> bool:
        """Take the arm somewhere; a polled leg ends early when `lost` becomes true. Return whether it got there."""
        self.moves.append((way or ("leg" if lost else "free"), place))
        if lost:
            self.legs += 1
            self.leg_began_s = self.now_s
        end_s = self.now_s + LEG_S
        while self.now_s < end_s:
            if lost and lost():
                self.stopped_s = self.now_s
                self.moves.append(("stop", place))
                return False
            self.advance(TICK_S)
        self.stands_at = self.ended_at(place) if lost else place
        return True

    def ended_at(self, place: tuple[float, ...]) -> tuple[float, ...]:
        """Return where a leg has ended that was sent to `place`."""
        off = self.fault.off if self._faulty() else (0.0, 0.0, 0.0)
        return tuple(sent + by for sent, by in zip(place, off, strict=True))

    def be_silent(self) -> None:
        """Let more than a minute pass: the daemon closes connections."""
        self.now_s += 70.0
        for close in self.closing:
            close()

    def halt(self) -> None:
        """Wait for the operator's key."""
        self.told.append("halt")
        if not self.keys:
            raise StoppedError
        self.keys -= 1
        self.fault = Fault()

    def garbled(self, line: str) -> str:
        """Return what arrives of a line."""
        return self.fault.garble(line) if self._faulty() else line

    def reachable(self, z: float) -> bool:
        """Whether the arm gets there; it takes a controller time to find out."""
        self.advance(0.15)
        return (
            not self._faulty()
            or ("high" if z > SERVED[2] + 25 else "low") not in self.fault.unreachable
        )

    def link_is(self, state: str) -> bool:
        """Whether the link is "refused" or "closed"."""
        return self.fault.link == state and self._faulty()

    def _faulty(self) -> bool:
        match self.fault.since:
            case "ask":
                return True
            case "answered":
                return (
                    self.now_s > self._answered_s + self.decides_within_s
                )  # decided, and before the next look
            case "recovered":
                return len(self.asks) <= 1
            case "second":
                return len(self.asks) > 1
            case "approach":
                return self.legs >= 1 and self.now_s > self.leg_began_s + 0.3
        return self.legs >= 2 and self.now_s > self.leg_began_s + 0.3


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """w, x, y, z of Rz(yaw) Ry(pitch) Rx(roll), degrees."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(math.radians(a) / 2), math.sin(math.radians(a) / 2)) for a in (roll, pitch, yaw)
    )
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
