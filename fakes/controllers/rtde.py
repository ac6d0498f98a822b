"""Fake Universal Robots controller: an RTDE server (protocol 1 and 2) for the real ur-rtde.

Packets are `u16 size, u8 type, payload`, big-endian; types and fields follow Universal Robots'
RTDE guide and its open client library. The port is fixed at 30004 in ur-rtde, so every fake
controller wants its own 127.x.y.z, and a process of its own: ur-rtde holds the GIL while it
connects.
"""

import asyncio
import contextlib
import math
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

from fakes.controllers.rtde_fields import FORMATS, OUTPUT_TYPES
from vgrd.geometry import Pose

PORT = 30004  # of RTDE, fixed in ur-rtde
CYCLE_S = 0.002  # of an e-Series controller (500 Hz, UR's RTDE guide)
_MAX_BACKLOG_S = 0.5  # a server that was held up longer leaves cycles out, it sends no flood
_VERSION, _CONTROLLER, _TEXT, _DATA, _OUTPUTS, _INPUTS, _START, _PAUSE = b"VvMUOISP"
_ROBOT_RUNNING = 7  # robot_mode RUNNING, UR's RTDE guide
_NORMAL, _PROTECTIVE_STOP = 1, 3  # safety_mode, idem
_STOPPED, _PLAYING = 1, 2  # runtime_state, idem
_POWER_ON, _PROGRAM_RUNNING = 1, 2  # bits of robot_status_bits, idem
_WARNING = 1

Value = float | Sequence[float]


@dataclass(frozen=True, slots=True, eq=False)
class RtdeState:
    """What the controller knows at one instant.

    base_from_wrist: the reported flange; wrist_from_tcp: the TCP active on the pendant (mm, rad);
    tcp_speed: x y z rx ry rz of the TCP in mm/s and rad/s; digital_inputs: bit field.
    """

    base_from_wrist: Pose
    wrist_from_tcp: Pose
    tcp_speed: Sequence[float] = (0.0,) * 6
    digital_inputs: int = 0
    program_running: bool = False
    protective_stop: bool = False


@dataclass(slots=True)
class RtdeFaults:
    """Faults to switch on while clients are connected.

    silent: accept and never answer; freeze: sockets stay open, no data; protective_stop: as if
    the arm had hit something; repeat: every sample twice; not_a_number: NaN in the pose; late_s:
    send this much after the instant; clock_s: added to the controller's clock; missing: names
    that this controller does not know.
    """

    silent: bool = False
    freeze: bool = False
    protective_stop: bool = False
    repeat: bool = False
    not_a_number: bool = False
    late_s: float = 0.0
    clock_s: float = 0.0
    missing: frozenset[str] = field(default_factory=frozenset)


def wire_pose(pose: Pose) -> tuple[float, ...]:
    """Return x y z in m and the rotation vector in rad, as a UR controller sends a pose."""
    return (*(pose.translation / 1000.0).tolist(), *pose.rotvec().tolist())


@lru_cache(maxsize=4)
def _wire_poses(wrist: Pose, tcp: Pose) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """TCP pose and offset on the wire; keyed by the objects, so an arm at rest costs nothing."""
    return wire_pose(wrist @ tcp), wire_pose(tcp)


def output_values(state: RtdeState, timestamp_s: float) -> dict[str, Value]:
    """Return the RTDE outputs that are not zero, in wire units."""
    pose, offset = _wire_poses(state.base_from_wrist, state.wrist_from_tcp)
    speed = tuple(v / 1000.0 for v in state.tcp_speed[:3]) + tuple(state.tcp_speed[3:])
    stopped = state.protective_stop
    running = state.program_running and not stopped
    return {
        "timestamp": timestamp_s,
        "actual_TCP_pose": pose,
        "target_TCP_pose": pose,
        "actual_TCP_speed": speed,
        "target_TCP_speed": speed,
        "tcp_offset": offset,
        "actual_digital_input_bits": state.digital_inputs,
        "robot_mode": _ROBOT_RUNNING,
        "safety_mode": _PROTECTIVE_STOP if stopped else _NORMAL,
        "safety_status": _PROTECTIVE_STOP if stopped else _NORMAL,
        "safety_status_bits": 0b100 if stopped else 0b1,
        "robot_status_bits": _POWER_ON | (_PROGRAM_RUNNING if running else 0),
        "runtime_state": _PLAYING if running else _STOPPED,
        "speed_scaling": 1.0,
        "target_speed_fraction": 1.0,
    }


class RtdeServer:
    """A controller at `host`; `state_source(now_s)` tells its state at a time of CLOCK_MONOTONIC.

    `async with` starts and stops it. `faults` may be changed at any time from the event loop.
    """

    def __init__(
        self,
        state_source: Callable[[float], RtdeState],
        host: str,
        port: int = PORT,
        version: tuple[int, int, int, int] = (5, 11, 0, 0),  # PolyScope 5.11, an e-Series
    ) -> None:
        self.state_source = state_source
        self.host = host
        self.port = port
        self.version = version
        self.faults = RtdeFaults()
        self._boot_s = time.monotonic() - 1000.0
        self._clients: set[_Client] = set()
        self._serving: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> "RtdeServer":
        self._server = await asyncio.start_server(self._serve, self.host, self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server:
            self._server.close()
        self.drop()
        await asyncio.gather(*self._serving, return_exceptions=True)

    def drop(self, *, reset: bool = False) -> None:
        """End every connection, with FIN or with RST."""
        for client in list(self._clients):
            client.end(reset=reset)

    def send_text(self, message: str, source: str = "vgrd fake") -> None:
        """Send a text message to every client, as a controller may at any time."""
        for client in list(self._clients):
            client.send_text(message, source)

    def controller_time_s(self, cycle: int) -> float:
        """Timestamp of a control cycle: seconds since the controller started, plus the fault."""
        return cycle * CYCLE_S + self.faults.clock_s

    def cycle_at(self, now_s: float) -> int:
        """Return the control cycle that runs at a time of the monotonic clock."""
        return math.floor((now_s - self._boot_s) / CYCLE_S)

    def values_at(self, cycle: int) -> dict[str, Value]:
        """RTDE outputs of one control cycle, faults applied."""
        state = self.state_source(self._boot_s + cycle * CYCLE_S)
        if self.faults.protective_stop:
            state = replace(state, protective_stop=True)
        values = output_values(state, self.controller_time_s(cycle))
        if self.faults.not_a_number:
            values["actual_TCP_pose"] = (math.nan,) * 6
        return values

    def due_s(self, cycle: int) -> float:
        """Time of the monotonic clock at which a cycle's data leave."""
        return self._boot_s + cycle * CYCLE_S + self.faults.late_s

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(self, reader, writer)
        self._clients.add(client)
        task = asyncio.create_task(client.run())
        self._serving.add(task)
        try:
            await task
        finally:
            self._clients.discard(client)
            self._serving.discard(task)


class _Client:
    """One connection: its protocol version, its recipe, its rate."""

    def __init__(
        self, server: RtdeServer, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._server = server
        self._reader = reader
        self._writer = writer
        self._protocol = 1
        self._frequency_hz = 125.0
        self._recipe: list[tuple[str, str]] = []
        self._input_recipes = 0
        self._stream: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Answer requests until the client leaves."""
        try:
            while True:
                size, kind = struct.unpack(">HB", await self._reader.readexactly(3))
                payload = await self._reader.readexactly(size - 3)
                if not self._server.faults.silent:
                    self._answer(kind, payload)
                    await self._writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            self._pause()
            self._writer.close()

    def end(self, *, reset: bool) -> None:
        """Close with FIN, or at once with RST."""
        if reset:
            reset_at_close = struct.pack("ii", 1, 0)
            with contextlib.suppress(OSError):
                self._writer.get_extra_info("socket").setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, reset_at_close
                )
            self._writer.transport.abort()
        else:
            self._writer.close()

    def send_text(self, message: str, source: str) -> None:
        text, origin = message.encode()[:255], source.encode()[:255]
        if self._protocol == 1:
            self._send(_TEXT, bytes([_WARNING]) + text)
        else:
            lengths = bytes([len(text)]) + text + bytes([len(origin)]) + origin
            self._send(_TEXT, lengths + bytes([_WARNING]))

    def _send(self, kind: int, payload: bytes) -> None:
        if not self._writer.is_closing():
            self._writer.write(struct.pack(">HB", 3 + len(payload), kind) + payload)

    def _answer(self, kind: int, payload: bytes) -> None:
        if kind == _VERSION:
            version = struct.unpack(">H", payload)[0]
            self._protocol = version if version in (1, 2) else self._protocol
            self._send(kind, bytes([version in (1, 2)]))
        elif kind == _CONTROLLER:
            self._send(kind, struct.pack(">4I", *self._server.version))
        elif kind == _OUTPUTS:
            self._send(kind, self._set_recipe(payload))
        elif kind == _INPUTS:
            names = [name for name in payload.decode().split(",") if name]
            self._send(kind, b"\0" + ",".join(["NOT_FOUND"] * len(names)).encode())
        elif kind == _START:
            self._send(kind, bytes([bool(self._recipe)]))
            if self._recipe and self._stream is None:
                self._stream = asyncio.create_task(self._stream_samples())
        elif kind == _PAUSE:
            self._pause()
            self._send(kind, b"\1")

    def _set_recipe(self, payload: bytes) -> bytes:
        """Take the names of the outputs, return their types.

        ur-rtde ends its list with a comma and crashes when the empty name is answered.
        """
        head = b""
        if self._protocol == 2:
            self._frequency_hz = struct.unpack(">d", payload[:8])[0]
            payload = payload[8:]
        names = [name for name in payload.decode().split(",") if name]
        types_by_name = {
            n: t for n, t in OUTPUT_TYPES.items() if n not in self._server.faults.missing
        }
        types = [types_by_name.get(name, "NOT_FOUND") for name in names]
        complete = "NOT_FOUND" not in types
        self._recipe = list(zip(names, types, strict=True)) if complete else []
        if self._protocol == 2:
            head = bytes([complete])
        return head + ",".join(types).encode()

    def _pause(self) -> None:
        if self._stream:
            self._stream.cancel()
            self._stream = None

    async def _stream_samples(self) -> None:
        """Send every n-th control cycle, stamped with that cycle also when sent late."""
        server = self._server
        every = max(1, round(1.0 / (self._frequency_hz * CYCLE_S)))
        cycle = server.cycle_at(time.monotonic())
        while not self._writer.is_closing():
            cycle += every
            wait_s = server.due_s(cycle) - time.monotonic()
            if wait_s < -_MAX_BACKLOG_S:
                cycle = server.cycle_at(time.monotonic())
            await asyncio.sleep(max(0.0, wait_s))
            if not server.faults.freeze:
                packet = self._pack(server.values_at(cycle))
                for _ in range(2 if server.faults.repeat else 1):
                    self._send(_DATA, packet)
                await self._writer.drain()

    def _pack(self, values: dict[str, Value]) -> bytes:
        parts = [b"\1"] if self._protocol == 2 else []
        for name, kind in self._recipe:
            form = FORMATS[kind]
            value = values.get(name, (0,) * int(form[0]) if len(form) > 1 else 0)
            numbers = value if isinstance(value, Sequence) else (value,)
            parts.append(struct.pack(">" + form, *numbers))
        return b"".join(parts)
