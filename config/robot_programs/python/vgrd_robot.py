"""Asks vgrd for an expected coordinate over Modbus TCP, decides, and takes a robot there.

For robots that are moved by a program on a PC, and the pattern for the other languages: one call of
`Program.step` per poll does what docs/robot-programs.md says, under its words. Copy this one file;
it needs Python 3.11 and nothing else. Edit five places: 1 ADDRESS, 2 REQUEST, 3 TAUGHT, 4 LIMITS,
5 ARM. Poses are (x, y, z, rx, ry, rz) of the flange in the robot's base: mm, rotation vector in rad.

Checked by machine: every row of the table and every fault of tests/robot_programs/scenarios.py, with
the real register server and stepped time. Not run on hardware. vgrd is not a safety function.

    python dry_run.py --point 1      # beside this file: asks, decides, moves an arm of numbers only
"""

import math
import socket
import struct
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, Protocol

Pose = tuple[float, float, float, float, float, float]


# --- 1 ADDRESS --------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Address:
    """Where the daemon serves its registers: [serving] of the cell file."""

    host: str = "127.0.0.1"
    port: int = 1502


# --- 2 REQUEST --------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Request:
    """What is asked for: a target of the cell file; OK_DEGRADED (2) only where it is precise enough."""

    point: int = 1
    object: int = 0
    degraded_allowed: bool = False


# --- 3 TAUGHT ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Taught:
    """The flange at the touch, as taught by hand; where the tool points, in the flange, length 1."""

    pose: Pose = (400.0, 0.0, 200.0, math.pi, 0.0, 0.0)
    tool_z: tuple[float, float, float] = (0.0, 0.0, 1.0)


# --- 4 LIMITS ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Limits:
    """As in docs/robot-programs.md, which says why; box: where the flange may go, mm."""

    link_s: float = 0.2
    heartbeat_s: float = 0.5
    answer_s: float = 3.0
    poll_s: float = 0.05
    age_ms: float = 1000
    u95_um: float = 1000
    step_mm: float = 50
    step_deg: float = 20
    approach_mm: float = 50
    agree_mm: float = 0.5
    agree_deg: float = 0.5
    attempts: int = 3
    pause_s: float = 0.5
    box_low: tuple[float, float, float] = (350.0, -50.0, 150.0)
    box_high: tuple[float, float, float] = (450.0, 50.0, 300.0)
    speed_mm_s: float = 100.0  # to the approach point
    last_leg_mm_s: float = 50.0  # to the coordinate, and back


# --- 5 ARM ------------------------------------------------------------------------------------------
class Arm(Protocol):
    """What the robot must be able to do; give the functions of your robot's library."""

    def move_to(self, pose: Pose, speed_mm_s: float) -> None:
        """Start a straight move of the flange and return at once."""
        ...

    def moving(self) -> bool:
        """Whether the last move still goes on, or the arm still brakes."""
        ...

    def stop(self) -> None:
        """End the motion, then brake; return at once."""
        ...

    def flange_pose(self) -> Pose:
        """Where the flange is."""
        ...

    def reachable(self, pose: Pose) -> bool:
        """Whether it can be reached in the configuration of the taught pose."""
        ...


# --- from here on nothing is to be edited -----------------------------------------------------------

MAP_VERSION: Final = 0x0100
FIRST, COUNT = 100, 49  # the registers that are read in one request: header, EC16, EC32
WORDS: Final[Mapping[str, int]] = {
    "MAPVER": 100,
    "HB": 101,
    "ECHO": 103,
    "STATUS": 104,
    "DETAIL": 105,
    "POINT": 106,
    "AGE": 107,
    "U95P": 108,
    "OBJECT": 113,
    "FMT": 114,
    "SEQ": 119,
    "EC32_X": 130,  # to 141: six values of two words, um and urad
    "EC32_ECHO": 144,
    "EC32_STATUS": 145,
    "EC32_SEQ": 146,
    "EC32_CRC": 147,  # and 148: of the words 130 to 146
}
SENTINEL: Final = -(2**31)
REQUEST_WORDS: Final = 32  # all of them are written: nothing of an earlier program stays
CMD_FRESH: Final = 2
LAST_TRIG: Final = 0xFFFF
OK, OK_DEGRADED, BUSY = 1, 2, 10
FORMAT_MASK: Final = 0x1F  # FMT: rotation format and frame; 0 is a rotation vector of the flange
PASSING: Final = (0, 10, 106, 201, 202, 205, 206, 302, 401, 403, 900, 901)  # STATUS: ask again


class Reaction(Enum):
    """What follows where a condition does not hold."""

    ASK_AGAIN = "ask again"
    STOP = "stop"


class Doubt(Exception):
    """A condition does not hold: the word of its row, and what follows."""

    def __init__(self, word: str, reaction: Reaction, text: str) -> None:
        self.word, self.reaction = word, reaction
        super().__init__(f"{word}: {text}")


class LinkLost(Exception):
    """No answer came, or one that refuses."""


class ModbusLink:
    """Modbus TCP: function 3 to read, 16 to write. Every call raises LinkLost."""

    def __init__(self, address: Address, timeout_s: float) -> None:
        self._address, self._timeout_s = address, timeout_s
        self._socket: socket.socket | None = None
        self._transaction = 0

    def open(self) -> None:
        """Connect anew."""
        self.close()
        try:
            self._socket = socket.create_connection(
                (self._address.host, self._address.port), self._timeout_s
            )
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise LinkLost(str(error)) from error

    def close(self) -> None:
        """Disconnect."""
        if self._socket:
            self._socket.close()
        self._socket = None

    def read(self) -> Sequence[int]:
        """Read the `COUNT` words from `FIRST` on in one request."""
        answer = self.exchange(struct.pack(">BHH", 3, FIRST, COUNT))
        if len(answer) != 2 + 2 * COUNT:
            raise LinkLost("the answer is of another length than was asked for")
        return struct.unpack(f">{COUNT}H", answer[2:])

    def write(self, words: Sequence[int]) -> None:
        """Write the words from register 0 on."""
        count = len(words)
        self.exchange(struct.pack(f">BHHB{count}H", 16, 0, count, 2 * count, *words))

    def exchange(self, request: bytes) -> bytes:
        """Send one request; the whole answer comes within the timeout. Raises LinkLost."""
        if self._socket is None:
            raise LinkLost("not connected")
        self._transaction = self._transaction % 0xFFFF + 1
        end_s = time.monotonic() + self._timeout_s
        try:
            self._socket.sendall(
                struct.pack(">HHHB", self._transaction, 0, len(request) + 1, 1) + request
            )
            transaction, _, length, _ = struct.unpack(">HHHB", self._receive(7, end_s))
            answer = self._receive(length - 1, end_s)
        except OSError as error:
            self.close()
            raise LinkLost(str(error)) from error
        if transaction != self._transaction or answer[:1] != request[:1]:
            self.close()
            raise LinkLost(f"the request was refused: {answer.hex()}")
        return answer

    def _receive(self, count: int, end_s: float) -> bytes:
        """Bytes of an answer. Raises OSError, TimeoutError when they do not come in time."""
        received = b""
        while self._socket and len(received) < count:
            self._socket.settimeout(max(end_s - time.monotonic(), 1e-3))
            part = self._socket.recv(count - len(received))
            if not part:
                raise ConnectionError("the other side closed the connection")
            received += part
        return received


def shifted(pose: Pose, axis: Sequence[float], mm: float) -> Pose:
    """Shift `pose` by `mm` along `axis`, which is given in the flange."""
    angle = math.hypot(*pose[3:])
    k = [r / angle for r in pose[3:]] if angle else [0.0, 0.0, 0.0]
    dot = sum(a * b for a, b in zip(k, axis, strict=True))
    cross = [
        k[1] * axis[2] - k[2] * axis[1],
        k[2] * axis[0] - k[0] * axis[2],
        k[0] * axis[1] - k[1] * axis[0],
    ]
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y, z = (
        p + mm * (a * cosine + c * sine + n * dot * (1 - cosine))
        for p, a, c, n in zip(pose[:3], axis, cross, k, strict=True)
    )
    return (x, y, z, *pose[3:])


def distance_mm(a: Pose, b: Pose) -> float:
    """How far apart two flanges are."""
    return math.dist(a[:3], b[:3])


def turn_deg(a: Pose, b: Pose) -> float:
    """The angle between two flanges; v and v * (1 - 2 pi / |v|) are the same rotation."""
    dot = sum(p * q for p, q in zip(_quaternion(a), _quaternion(b), strict=True))
    return math.degrees(2 * math.acos(min(1.0, abs(dot))))


def _quaternion(pose: Pose) -> tuple[float, ...]:
    angle = math.hypot(*pose[3:])
    scale = math.sin(angle / 2) / angle if angle else 0.5
    return (math.cos(angle / 2), *(r * scale for r in pose[3:]))


def check_numbers(*places: object) -> None:
    """Raise ValueError for nan: no comparison with it would ever doubt anything. inf is no limit, said in words."""
    for place in places:
        for name, number in vars(place).items():
            if any(map(math.isnan, number if isinstance(number, Sequence) else (number,))):
                raise ValueError(f"{type(place).__name__}.{name} is {number}: give numbers")


class State(Enum):
    """Where the program is."""

    CONNECT = "connect"
    CLEAR = "clear"
    ASK = "ask"
    WAIT = "wait for the answer"
    PAUSE = "pause before asking again"
    TO_APPROACH = "to the approach point"
    LAST_LEG = "last leg"
    AT_POINT = "at the point"
    BRAKE = "brake"
    RETREAT = "retreat"
    DONE = "done"
    STOPPED = "stopped"


READING: Final = (State.CLEAR, State.WAIT, State.PAUSE, State.TO_APPROACH, State.LAST_LEG)
MOVING: Final = (State.TO_APPROACH, State.LAST_LEG)
RESTING: Final = (State.AT_POINT, State.DONE, State.STOPPED)


@dataclass
class Answer:
    """An accepted coordinate and the SEQ under which it stands."""

    pose: Pose
    seq: int


@dataclass
class Program:
    """One robot's program: `start`, then `step` every `poll_s` until `state` is one of RESTING.

    At AT_POINT do what is to be done there, then `leave`. At STOPPED `report` says why; `resume`
    when the operator has pressed the key.
    """

    arm: Arm
    link: ModbusLink
    request: Request = field(default_factory=Request)
    taught: Taught = field(default_factory=Taught)
    limits: Limits = field(default_factory=Limits)
    clock: Callable[[], float] = time.monotonic
    trig: int = 0
    state: State = State.DONE
    report: str = ""
    word: str = ""
    status: int = 0

    def __post_init__(self) -> None:
        check_numbers(self.limits, self.taught)
        self._begin()

    def start(self) -> None:
        """Begin: connect, ask, go."""
        self._begin()
        self.state = State.CONNECT

    def _begin(self) -> None:
        self.report, self.word = "", ""
        self._answer: Answer | None = None
        self._at_approach = False
        self._asked = self._rounds = 0
        self._since_s = self._beat_s = self.clock()
        self._beat, self._beat_moved = -1, False

    def leave(self) -> None:
        """RETREAT: back from the point, the way it came."""
        self._go_back()

    def resume(self) -> None:
        """RESUME: one key of the operator; begins by asking."""
        if self.state is State.STOPPED:
            self.start()

    def step(self) -> State:
        """Do what is due now; call it every `poll_s`."""
        now_s = self.clock()
        try:
            words = self._read(now_s) if self.state in READING else ()
            self._due()(words, now_s)
        except LinkLost as lost:
            self._react(Doubt("LINK", Reaction.STOP, str(lost)), now_s)
        except Doubt as doubt:
            self._react(doubt, now_s)
        return self.state

    def _due(self) -> Callable[[Sequence[int], float], None]:
        due = {
            State.CONNECT: self._connect,
            State.CLEAR: self._clear,
            State.ASK: self._ask,
            State.WAIT: self._wait,
            State.PAUSE: self._pause,
            State.TO_APPROACH: self._to_approach,
            State.LAST_LEG: self._last_leg,
            State.BRAKE: self._brake,
            State.RETREAT: self._retreat,
        }
        return due.get(self.state, self._rest)

    # --- one function per state

    def _connect(self, _: Sequence[int], now_s: float) -> None:
        self.link.open()
        words = self.link.read()
        if value(words, "MAPVER") != MAP_VERSION:
            raise Doubt("MAP_VERSION", Reaction.STOP, f"MAPVER is {value(words, 'MAPVER')}")
        self.link.write([0] * REQUEST_WORDS)  # TRIG 0 clears what an earlier program asked
        self._beat, self._beat_s, self._beat_moved = value(words, "HB"), now_s, False
        self._since_s, self.state = now_s, State.CLEAR

    def _clear(self, words: Sequence[int], now_s: float) -> None:
        if value(words, "ECHO") == 0 and value(words, "STATUS") != BUSY and self._beat_moved:
            self.state = State.ASK
        elif now_s - self._since_s > self.limits.answer_s:
            raise Doubt("ECHO", Reaction.STOP, "TRIG 0 does not clear")

    def _ask(self, _: Sequence[int], now_s: float) -> None:
        self.trig = self.trig % LAST_TRIG + 1  # TRIG: after 65535 comes 1
        self._asked += 1
        words = [self.trig, CMD_FRESH, self.request.point, 0, 0, self.request.object]
        self.link.write(words + [0] * (REQUEST_WORDS - len(words)))
        self._since_s, self.state = now_s, State.WAIT

    def _wait(self, words: Sequence[int], now_s: float) -> None:
        if value(words, "ECHO") == self.trig and value(words, "STATUS") != BUSY:
            self._use(self._accept(words))
        elif now_s - self._since_s > self.limits.answer_s:
            raise Doubt("ECHO", Reaction.ASK_AGAIN, f"no answer to TRIG {self.trig}")

    def _pause(self, _: Sequence[int], now_s: float) -> None:
        if now_s - self._since_s >= self.limits.pause_s:
            self.state = State.ASK

    def _to_approach(self, words: Sequence[int], _: float) -> None:
        self._poll(words)
        if not self.arm.moving():
            self._check_arrival(self._approach())
            self._at_approach, self._asked, self.state = True, 0, State.ASK

    def _last_leg(self, words: Sequence[int], _: float) -> None:
        self._poll(words)
        if not self.arm.moving() and self._answer:
            self._check_arrival(self._answer.pose)
            self.state = State.AT_POINT

    def _brake(self, _: Sequence[int], __: float) -> None:
        if self.arm.moving():
            return
        if self._at_approach:
            self._go_back()
        else:
            self.state = State.STOPPED

    def _retreat(self, _: Sequence[int], __: float) -> None:
        if not self.arm.moving():
            self.state = State.STOPPED if self.word else State.DONE

    def _rest(self, _: Sequence[int], __: float) -> None:
        """Nothing moves, nothing is asked."""

    # --- decisions

    def _read(self, now_s: float) -> Sequence[int]:
        """LINK and HEARTBEAT."""
        words = self.link.read()
        if value(words, "HB") != self._beat:
            self._beat, self._beat_s, self._beat_moved = value(words, "HB"), now_s, True
        elif now_s - self._beat_s > self.limits.heartbeat_s:
            raise Doubt("HEARTBEAT", Reaction.STOP, "HB stands still")
        return words

    def _accept(self, words: Sequence[int]) -> Answer:
        """Return the coordinate when every condition before use holds. Raises Doubt."""
        self._check_status(words)
        asked = (self.request.point, self.request.object)
        if (value(words, "POINT"), value(words, "OBJECT")) != asked:
            raise Doubt("POINT", Reaction.STOP, "the answer is for another point or object")
        if value(words, "FMT") & FORMAT_MASK:
            raise Doubt("FORMAT", Reaction.STOP, f"FMT is {value(words, 'FMT')}")
        seq = value(words, "SEQ")
        proof = (value(words, "EC32_SEQ"), value(words, "EC32_ECHO"))
        if seq % 2 or proof != (seq, self.trig):
            raise Doubt("SEQ", Reaction.ASK_AGAIN, "the block is not of one answer")
        steps = coordinate(words)
        if SENTINEL in steps:
            raise Doubt("SENTINEL", Reaction.STOP, "a sentinel beside a good STATUS")
        if not is_whole(words):
            raise Doubt("SEQ", Reaction.ASK_AGAIN, "EC32_CRC is not that of the block")
        if value(words, "AGE") > self.limits.age_ms:
            raise Doubt("AGE", Reaction.ASK_AGAIN, f"{value(words, 'AGE')} ms old")
        if value(words, "U95P") > self.limits.u95_um:
            raise Doubt("U95", Reaction.STOP, f"{value(words, 'U95P')} um uncertain")
        x, y, z, rx, ry, rz = steps
        pose = (x / 1e3, y / 1e3, z / 1e3, rx / 1e6, ry / 1e6, rz / 1e6)
        self._check_place(pose)
        return Answer(pose, seq)

    def _check_status(self, words: Sequence[int]) -> None:
        """STATUS, of the header and of the block."""
        for name in ("STATUS", "EC32_STATUS"):
            self.status = value(words, name)
            if self.status == OK or (self.status == OK_DEGRADED and self.request.degraded_allowed):
                continue
            passing = self.status in PASSING
            reaction = Reaction.ASK_AGAIN if passing else Reaction.STOP
            detail = value(words, "DETAIL")
            raise Doubt("STATUS", reaction, f"{name} {self.status}, DETAIL {detail}")

    def _check_place(self, pose: Pose) -> None:
        """BOX, STEP and REACH."""
        limits, taught = self.limits, self.taught.pose
        inside = zip(limits.box_low, pose[:3], limits.box_high, strict=True)
        if not all(low <= p <= high for low, p, high in inside):
            raise Doubt("BOX", Reaction.STOP, f"outside of the box: {pose[:3]}")
        off_mm, off_deg = distance_mm(pose, taught), turn_deg(pose, taught)
        if off_mm > limits.step_mm or off_deg > limits.step_deg:
            raise Doubt("STEP", Reaction.STOP, f"{off_mm:.1f} mm, {off_deg:.1f} deg from taught")
        if not (self.arm.reachable(pose) and self.arm.reachable(self._approach(pose))):
            raise Doubt("REACH", Reaction.STOP, "cannot be reached as taught")

    def _use(self, answer: Answer) -> None:
        """The first answer leads to the approach point, the second along the tool: ASK_AGAIN."""
        first, self._answer = self._answer, answer
        if first is None or not self._at_approach:
            self._to(State.TO_APPROACH, self._approach(), self.limits.speed_mm_s)
        elif (
            distance_mm(first.pose, answer.pose) <= self.limits.agree_mm
            and turn_deg(first.pose, answer.pose) <= self.limits.agree_deg
        ):
            self._to(State.LAST_LEG, answer.pose, self.limits.last_leg_mm_s)
        elif (rounds := self._rounds + 1) < self.limits.attempts:
            self._rounds, self._at_approach = rounds, False
            self._to(State.TO_APPROACH, self._approach(), self.limits.last_leg_mm_s)
        else:
            raise Doubt("ASK_AGAIN", Reaction.STOP, "the answers do not agree")

    def _poll(self, words: Sequence[int]) -> None:
        """POLL, while the arm moves."""
        self._check_status(words)
        seq = self._answer.seq if self._answer else None
        if (value(words, "ECHO"), value(words, "EC32_SEQ")) != (self.trig, seq):
            raise Doubt("POLL", Reaction.STOP, "another answer took the place of the one accepted")

    def _check_arrival(self, pose: Pose) -> None:
        """APPROACH, for both legs: something else may have ended the motion."""
        off_mm = distance_mm(self.arm.flange_pose(), pose)
        if not off_mm <= self.limits.agree_mm:  # also where the arm tells no number
            raise Doubt("APPROACH", Reaction.STOP, f"the arm stands {off_mm:.1f} mm off")

    # --- motion

    def _approach(self, pose: Pose | None = None) -> Pose:
        """APPROACH: back along the tool from the coordinate."""
        if pose is None:
            pose = self._answer.pose if self._answer else self.taught.pose
        return shifted(pose, self.taught.tool_z, -self.limits.approach_mm)

    def _to(self, state: State, pose: Pose, speed_mm_s: float) -> None:
        self.arm.move_to(pose, speed_mm_s)
        self.state = state

    def _go_back(self) -> None:
        self._to(State.RETREAT, self._approach(), self.limits.last_leg_mm_s)

    def _react(self, doubt: Doubt, now_s: float) -> None:
        """Ask again while nothing moves and it may pass; else STOP."""
        again = doubt.reaction is Reaction.ASK_AGAIN and self._asked < self.limits.attempts
        if again and self.state not in MOVING:
            self._since_s, self.state = now_s, State.PAUSE
            return
        self.word, self.report = doubt.word, str(doubt)
        if self.state in MOVING:
            self.arm.stop()
            self.state = State.BRAKE
        else:
            self.state = State.STOPPED


def value(words: Sequence[int], name: str) -> int:
    """One register of the words that were read."""
    return words[WORDS[name] - FIRST]


def coordinate(words: Sequence[int]) -> tuple[int, ...]:
    """The six signed numbers of the int32 block."""
    at = WORDS["EC32_X"] - FIRST
    return struct.unpack(">6i", struct.pack(">12H", *words[at : at + 12]))


def is_whole(words: Sequence[int]) -> bool:
    """Whether the int32 block is as the daemon wrote it."""
    first, last = WORDS["EC32_X"] - FIRST, WORDS["EC32_CRC"] - FIRST
    block = struct.pack(f">{last - first}H", *words[first:last])
    return zlib.crc32(block) == words[last] << 16 | words[last + 1]
