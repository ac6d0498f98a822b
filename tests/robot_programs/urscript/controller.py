"""A Universal Robots controller in stepped time: threads in frames, Modbus signals, an arm, a pendant."""

import math
import struct
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.robot_programs.cell import READS
from tests.robot_programs.world import World, approach_of, pose_of
from vgrd.geometry import Pose

FRAME_S = 0.008  # of a CB3, the longest; 0.002 on newer ones
TCP = Pose.from_rotvec((0.0, 0.0, 0.3), (10.0, -5.0, 120.0))  # mm: active all the time
MM = 1e3
LARGEST = 2**31
TURN_S = 0.003  # between two signals: each has its own moment within the period
HAND_OVER_S = 30.0  # for one frame of a thread; far more than it takes


Span = tuple[int, int]  # first register and how many


class KilledError(BaseException):
    """Ends a thread of the program that was killed."""


class Int32(int):
    """A whole number as the controller has it. Raises OverflowError where it would wrap."""

    def _fits(self, number: Any) -> Any:
        if isinstance(number, float) or number is NotImplemented:
            return number
        if not -LARGEST <= number < LARGEST:
            raise OverflowError(f"{number} does not fit 32 bits")
        return Int32(number)

    def __add__(self, other: Any) -> Any:
        return self._fits(int(self) + other)

    def __sub__(self, other: Any) -> Any:
        return self._fits(int(self) - other)

    def __mul__(self, other: Any) -> Any:
        return self._fits(int(self) * other)


class PoseValue(list):
    """p[...]: m and rad."""

    def __class_getitem__(cls, items: Any) -> "PoseValue":
        return cls(items)


class Joints(list):
    """Joint positions, which stand for the pose of the flange that they lead to."""


class Task:
    """A thread of the program: a thread of ours that has the word for one frame at a time."""

    def __init__(self, body: Callable[[], None]):
        self.error: BaseException | None = None
        self.killed = False
        self.moves = False
        self._go, self._back = threading.Semaphore(0), threading.Semaphore(0)
        self._body = body
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def lives(self) -> bool:
        """Whether it has more to do."""
        return self._thread.is_alive()

    def frame(self) -> None:
        """Let it run until it gives the word back or ends; its error is ours."""
        self._go.release()
        assert self._back.acquire(timeout=HAND_OVER_S), "a thread never gives the frame back"
        if self.error:
            raise self.error

    def give_back(self) -> None:
        """From inside: wait for the next frame."""
        self._back.release()
        self._go.acquire()
        if self.killed:
            raise KilledError

    def kill(self) -> None:
        """From outside: it never runs again."""
        self.killed = True
        if self.lives:
            self.frame()
            self._thread.join()

    def _run(self) -> None:
        self._go.acquire()
        try:
            if not self.killed:
                self._body()
        except KilledError:
            pass
        except BaseException as error:  # noqa: BLE001 - told by `frame`
            self.error = error
        self._back.release()


class Controller:
    """Runs a translated program, frame by frame; `texts` are what its pendant showed."""

    def __init__(self, world: World):
        self.world, self.arm, self.cell = world, world.arm, world.cell
        self.texts: list[str] = []
        self.waits_for_key = False
        self._tasks: list[Task] = []
        self._now: Task | None = None
        self._signals: dict[str, _Signal] = {}

    def start(self, main: Callable[[], None]) -> Task:
        """A program begins with `main`."""
        self._tasks.append(task := Task(main))
        return task

    def frame(self) -> None:
        """Each thread has its turn, then time passes; while a popup waits, time only."""
        for task in list(self._tasks):
            if task.lives and not task.killed and not self.waits_for_key:
                self._now = task
                task.frame()
        self.advance(FRAME_S)

    def close(self) -> None:
        """Nothing of the program runs any more."""
        for task in self._tasks:
            task.error = None
            task.kill()

    def advance(self, seconds: float) -> None:
        """Time passes, and signals are exchanged."""
        self.world.advance(seconds)
        for signal in self._signals.values():
            signal.exchange_if_due()

    # --- flow

    def sync(self) -> None:
        self._now.give_back()

    def sleep(self, seconds: float) -> None:
        end_s = self.world.clock.monotonic() + seconds
        while self.world.clock.monotonic() < end_s:
            self.sync()

    def get_steptime(self) -> float:
        return FRAME_S

    def run_(self, function: Callable[[], None]) -> Task:
        self._tasks.append(task := Task(function))
        return task

    def kill_(self, task: Task) -> None:
        task.kill()

    def join_(self, task: Task) -> None:
        while task.lives:
            self.sync()

    def popup(self, text: str, title: str, warning: bool, error: bool, blocking: bool) -> None:
        """All threads stand until somebody presses Continue: sets `waits_for_key` to False."""
        assert blocking
        self.texts.append(text)
        self.waits_for_key = True
        self.sync()

    def textmsg(self, first: object, second: object = "") -> None:
        self.texts.append(f"{first}{second}")

    def str_cat(self, first: object, second: object) -> str:
        return f"{first}{second}"

    # --- poses

    def pose_trans(self, first: list, second: list) -> PoseValue:
        return _value(_pose(first) @ _pose(second))

    def pose_inv(self, pose: list) -> PoseValue:
        return _value(_pose(pose).inverse())

    def norm(self, numbers: list) -> float:
        return float(np.linalg.norm(numbers))

    def integer_to_binary_list(self, number: int) -> list[bool]:
        return [bool(number >> bit & 1) for bit in range(32)]

    # --- motion

    def get_tcp_offset(self) -> PoseValue:
        return _value(TCP)

    def get_actual_tool_flange_pose(self) -> PoseValue:
        return _value(self.arm.flange)

    def get_inverse_kin_has_solution(self, tcp: list, near: list) -> bool:
        assert len(near) == 6
        coordinate = self.cell.standing_coordinate
        places = {"coordinate": pose_of(coordinate), "approach": approach_of(coordinate)}
        flange = _flange(tcp).translation
        return all(
            np.abs(places[what].translation - flange).max() > 1e-3
            for what in self.arm.out_of_reach
        )

    def get_inverse_kin(self, tcp: list, near: list) -> Joints:
        assert self.get_inverse_kin_has_solution(tcp, near)
        return Joints(tcp)

    def movej(self, joints: Joints, acceleration: float, speed: float) -> None:
        assert isinstance(joints, Joints), "a pose would choose its own elbow"
        self._move(joints, 100.0 * speed / 0.5)  # mm/s: an arm of 0.2 m that turns

    def movel(self, tcp: list, acceleration: float, speed: float) -> None:
        self._move(tcp, speed * MM)

    def stopl(self, deceleration: float) -> None:
        commanding = [task for task in self._tasks if task.moves and task.lives]
        assert not commanding, "two threads command motion"
        self.arm.stop()
        while self.arm.moving:
            self.sync()

    def _move(self, tcp: list, mm_s: float) -> None:
        task = self._now
        self.arm.move(_flange(tcp), mm_s)
        task.moves = True
        while self.arm.moving:
            self.sync()
        task.moves = False

    # --- Modbus

    def modbus_add_rw_signal(self, ip, unit, first, reads, to, writes, name, in_turn) -> None:
        self._add(name, _Signal(self.world, (first, reads), (to, writes), (3, 23)), in_turn)

    def modbus_add_signal(self, ip, unit, address, kind, name, in_turn) -> None:
        functions = {2: (4, 0), 3: (3, 6)}[kind]
        self._add(name, _Signal(self.world, (address, 1), (address, 1), functions), in_turn)

    def modbus_set_signal_update_frequency(self, name: str, hertz: int) -> None:
        self._signals[name].period_s = 1 / hertz

    def modbus_set_signal_watchdog(self, name: str, seconds: float) -> None:
        self._signals[name].watchdog_s = seconds

    def modbus_get_error(self, name: str) -> int:
        return self._signals[name].error

    def modbus_get_time_since_signal_invalid(self, name: str) -> float:
        return self._signals[name].age_s

    def modbus_get_signal_status(self, name: str, secondary: bool) -> Int32 | list[Int32]:
        assert not secondary
        signal = self._signals[name]
        assert signal.age_s < signal.watchdog_s, "the controller stops the program"
        words = [Int32(word) for word in signal.words]
        return words if len(words) > 1 else words[0]

    def modbus_set_output_register(self, name: str, value: object, secondary: bool) -> None:
        assert not secondary
        words = value if isinstance(value, list) else [value]
        self._signals[name].write(words)

    def _add(self, name: str, signal: "_Signal", in_turn: bool) -> None:
        assert 1 <= len(name) <= 20
        assert in_turn, "requests are not to be sent before the last is answered"
        signal.delay(TURN_S * len(self._signals))
        self._signals[name] = signal


class _Signal:
    """Reads; from the first write on it writes each time. Old words stay when nothing comes."""

    def __init__(self, world: World, reads: Span, writes: Span, functions: tuple[int, int]):
        self.period_s, self.watchdog_s = 0.1, math.inf
        self.words: tuple[int, ...] = (0,) * reads[1]
        self.error = -2  # disconnected
        self._world, self._reads, self._writes, self._functions = world, reads, writes, functions
        self._output: bytes | None = None
        self._due_s = self._good_s = world.clock.monotonic()

    @property
    def age_s(self) -> float:
        """Since the last good answer."""
        return self._world.clock.monotonic() - self._good_s

    def delay(self, seconds: float) -> None:
        """Its turn comes later."""
        self._due_s += seconds

    def write(self, words: list[int]) -> None:
        """To be sent from now on."""
        assert len(words) == self._writes[1]
        self._output = struct.pack(f">{len(words)}H", *words)

    def exchange_if_due(self) -> None:
        """One request and its answer."""
        now_s = self._world.clock.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + self.period_s
        pdu = self._request()
        answer = self._world.cell.exchange(pdu)
        if answer is None or answer[0] != pdu[0]:
            self.error = -2 if answer is None else answer[1]
            return
        self.error, self._good_s = 0, now_s
        if pdu[0] in READS:
            self.words = struct.unpack(f">{self._reads[1]}H", answer[2:])

    def _request(self) -> bytes:
        reads, writes = self._functions
        if self._output is None:
            return struct.pack(">BHH", reads, *self._reads)
        if writes == 6:
            return struct.pack(">BH", writes, self._writes[0]) + self._output
        size = len(self._output)
        return struct.pack(">BHHHHB", writes, *self._reads, *self._writes, size) + self._output


def _pose(value: list) -> Pose:
    return Pose.from_rotvec(value[3:], [MM * metres for metres in value[:3]])


def _value(pose: Pose) -> PoseValue:
    return PoseValue([*map(float, pose.translation / MM), *map(float, pose.rotvec())])


def _flange(tcp: list) -> Pose:
    return _pose(tcp) @ TCP.inverse()
