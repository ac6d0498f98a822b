"""The scripted robot program: asks for an expected coordinate over Modbus, goes there, stops when in doubt.

It knows only the register map and its own arm, like the programs in config/; pymodbus is its client.
"""

import struct
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from fakes.world.world import World
from vgrd.geometry import Array, Pose
from vgrd.registers import REQUEST, RESPONSE, Command, PolicyCode, State, Status

POLL_S = 0.01  # half of the 20 ms in which the registers change: none is missed
HEARTBEAT_LOST_S = 0.5  # five of HB's steps of 100 ms
ANSWER_TIMEOUT_S = 5.0  # beyond the daemon's own 2 s: then it does not answer at all
APPROACH_MM = 25.0  # the tool comes along its axis, and is clear of the object before
LINK_TIMEOUT_S = 1.0  # a gate that lives answers in milliseconds
# What passes by itself on a busy machine: the program stops, goes back and asks again.
PASSING = (
    Status.TIMEOUT,
    Status.CAMERA_OFFLINE,
    Status.GRAB_TIMEOUT,
    Status.IMAGE_TOO_OLD,
    Status.ROBOT_OFFLINE,
    Status.ROBOT_MOVING,
    Status.INTERNAL_ERROR,
    Status.STARTING,
)


class Stopped(Exception):
    """The program stopped the arm: why, and when it knew (monotonic)."""

    def __init__(self, reason: str, status: Status | None = None) -> None:
        self.reason = reason
        self.status = status
        self.at_s = time.monotonic()
        super().__init__(reason)

    @property
    def passes(self) -> bool:
        """It may pass by itself: no link, no heartbeat, no answer, or one of `PASSING`."""
        return self.status is None or self.status in PASSING


@dataclass(frozen=True, slots=True, eq=False)
class Reply:
    """A valid answer as the robot understood it; latency from the write to the valid read."""

    base_from_wrist: Pose
    age_s: float
    latency_s: float
    u95_mm: float


class RobotProgram:
    """One robot with one connection to the registers; `repeats` counts the requests that it made again."""

    def __init__(
        self, world: World, host: str, port: int, link_timeout_s: float = LINK_TIMEOUT_S
    ) -> None:
        self.world = world
        self.repeats = 0
        self.client: Any = ModbusTcpClient(host, port=port, timeout=link_timeout_s, retries=0)
        self.trigger = int(time.monotonic() * 10) % 30000
        self._beat = (-1, 0.0)

    def __enter__(self) -> "RobotProgram":
        self.client.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def read(self) -> dict[str, float]:
        """Read the whole response block at once; Stopped when the link or the heartbeat is gone."""
        values = self.view()
        self._watch_beat(int(values["HB"]))
        return values

    def view(self) -> dict[str, float]:
        """Read the whole response block at once, whatever the heartbeat; Stopped when the link is gone."""
        return RESPONSE.decode(self.block())

    def block(self) -> bytes:
        """Bytes of the response block, in one read; Stopped when the link is gone."""
        try:
            reply = self.client.read_holding_registers(RESPONSE.start, count=68, device_id=1)
        except ModbusException as err:
            raise Stopped(f"no link: {err}") from err
        if reply.isError():
            raise Stopped(f"registers refused: {reply}")
        return struct.pack(">68H", *reply.registers)

    def ask(
        self,
        point: int,
        command: Command = Command.EC_FRESH,
        policy: PolicyCode = PolicyCode.CONFIGURED,
    ) -> Reply:
        """Request a point and wait for the answer; Stopped on anything but OK."""
        asked_s = self.request(point, command, policy)
        while time.monotonic() - asked_s < ANSWER_TIMEOUT_S:
            values = self.read()
            busy = int(values["STATE"]) & State.BUSY
            if int(values["ECHO"]) == self.trigger and not busy:
                return self._reply(values, time.monotonic() - asked_s)
            time.sleep(POLL_S)
        raise Stopped("no answer")

    def request(
        self,
        point: int,
        command: Command = Command.EC_FRESH,
        policy: PolicyCode = PolicyCode.CONFIGURED,
    ) -> float:
        """Write a request; returns when (monotonic). Stopped when it was not taken."""
        self.trigger = self.trigger % 60000 + 1
        request = dict.fromkeys((field.name for field in REQUEST.fields), 0)
        request |= {
            "TRIG": self.trigger,
            "CMD": command,
            "POINT": point,
            "OPT": policy << 8,
        }
        words = struct.unpack(">32H", REQUEST.encode(request))
        asked_s = time.monotonic()
        try:
            written = self.client.write_registers(0, list(words), device_id=1)
        except ModbusException as err:
            raise Stopped(f"no link: {err}") from err
        if written.isError():
            raise Stopped(f"the request was refused: {written}")
        return asked_s

    def ask_until_good(
        self,
        point: int,
        within_s: float,
        pause_s: float = 0.05,  # leaves the daemon its time; short beside an answer (0.5 s)
    ) -> Reply:
        """Ask again as long as the reason may pass by itself, at most `within_s`; then Stopped."""
        end_s = time.monotonic() + within_s
        while True:
            try:
                return self.ask(point)
            except Stopped as stop:
                if not stop.passes or time.monotonic() > end_s:
                    raise
                self.repeats += 1
                time.sleep(pause_s)

    def touch(self, reply: Reply) -> None:
        """Go to the coordinate by way of an approach above it, watching the answer on the way."""
        goal = reply.base_from_wrist
        axis = goal.rotation @ self.world.layout.tool_axis_in_wrist
        self.go(Pose(goal.rotation, goal.translation - APPROACH_MM * axis), watch=True)
        self.go(goal, watch=True)

    def go(self, base_from_wrist: Pose, *, watch: bool = False) -> None:
        """Move the active TCP so that the flange stands there, as `movel(pose_trans(...))` does."""
        tcp = self.world.arm.wrist_from_tcp
        now = time.monotonic()
        arrival = self.world.move_tcp(base_from_wrist.compose(tcp), now)
        while time.monotonic() < arrival:
            if watch:
                self.check(self.read())
            time.sleep(min(POLL_S, max(0.0, arrival - time.monotonic())))

    def check(self, values: dict[str, float]) -> None:
        """Stop the arm unless the registers still hold a valid answer."""
        status = Status(int(values["STATUS"]))
        if not status.is_ok or not int(values["STATE"]) & State.VALID:
            raise Stopped(f"{int(status)} {status.name}: {status.description}", status)

    def follow(self, point: int, until_s: float) -> None:
        """Follow an object: ask again and again and never trust an answer that is not OK."""
        while time.monotonic() < until_s:
            self.check(self.read())
            self.ask(point)

    def watch(self, until_s: float) -> None:
        """Go by one answer as long as it stands, without asking again; Stopped when it ends."""
        while time.monotonic() < until_s:
            self.check(self.read())
            time.sleep(POLL_S)

    def lift(self) -> None:
        """Go straight back from where the tool is."""
        flange = self.world.reported_flange(time.monotonic())
        axis = flange.rotation @ self.world.layout.tool_axis_in_wrist
        self.go(Pose(flange.rotation, flange.translation - APPROACH_MM * axis))

    def _reply(self, values: dict[str, float], latency_s: float) -> Reply:
        self.check(values)
        um: Array = np.array([values[f"EC32_{axis}"] for axis in ("X", "Y", "Z")])
        urad: Array = np.array([values[f"EC32_{axis}"] for axis in ("RX", "RY", "RZ")])
        return Reply(
            Pose.from_rotvec(urad * 1e-6, um * 1e-3),
            values["AGE"] / 1000,
            latency_s,
            values["EC32_U95"] / 1000,
        )

    def _watch_beat(self, beat: int) -> None:
        now_s = time.monotonic()
        last, since_s = self._beat
        if beat != last:
            self._beat = (beat, now_s)
        elif now_s - since_s > HEARTBEAT_LOST_S:
            self._beat = (beat, now_s)
            raise Stopped("the heartbeat stands still")
