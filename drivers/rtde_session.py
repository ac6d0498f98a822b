"""A small RTDE client of our own, for what ur-rtde cannot do: `tcp_offset`, and time limits.

Wire format as in Universal Robots' RTDE guide: `u16 size, u8 type, payload`, big-endian, TCP
30004.
"""

import contextlib
import socket
import struct
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.clock_mapping import ClockMapping
from vgrd.clock import Clock
from vgrd.errors import BadReading, DeviceError, DeviceRefused, DeviceUnavailable

PORT = 30004  # UR's RTDE guide
_PROTOCOL = 2  # with a frequency of its own for each client
_VERSION = ord("V")  # types of packet: request the protocol version
_CONTROLLER = ord("v")  # get the version of the controller
_DATA = ord("U")  # data package
_OUTPUTS = ord("O")  # set up the outputs
_START = ord("S")  # start the stream
_ACCEPTED = b"\1"
_FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I", "UINT64": "Q"}
_HEADER = struct.Struct(">HB")  # size of the packet, its type
_READ_BYTES = 65536  # at once: a u16 holds the size of a packet
_SAMPLES = 256  # remembered; chosen: half a second at 500 Hz, for a thread that is held up
_PATIENCE = 10  # samples; chosen: so many without the wanted time mean that it never comes
_WAKE_S = 0.2  # chosen: after so long without data the thread looks whether it is to end
_JUMP_S = 0.1  # of the controller's clock; chosen: more than a busy machine delays a packet

Values = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class RtdeSample:
    """One control cycle: TCP pose and TCP offset in wire units (m, rotation vector in rad)."""

    controller_s: float
    received_s: float
    tcp_pose: Values
    tcp_offset: Values


class RtdeConnection:
    """A stream of `timestamp`, `actual_TCP_pose`, `tcp_offset`, and the `other_names`.

    Raises DeviceUnavailable when nobody answers within `timeout_s`, DeviceRefused when the
    controller lacks a name or speaks another protocol.
    """

    _NAMES = ("timestamp", "actual_TCP_pose", "tcp_offset")

    def __init__(
        self,
        host: str,
        frequency_hz: float,
        timeout_s: float,
        clock: Clock,
        other_names: Sequence[str] = (),
    ) -> None:
        self._where = f"the UR controller at {host}:{PORT}"
        self._clock = clock
        self._buffer = bytearray()
        try:
            self._socket = socket.create_connection((host, PORT), timeout_s)
        except OSError as error:
            raise DeviceUnavailable(
                f"cannot connect to {self._where}: {error}; is it on and reachable?"
            ) from error
        try:
            self._handshake(
                [*self._NAMES, *other_names], frequency_hz, clock.monotonic() + timeout_s
            )
        except DeviceError:
            self._socket.close()
            raise
        except (struct.error, IndexError, UnicodeDecodeError) as error:
            self._socket.close()
            raise DeviceRefused(f"{self._where} does not speak RTDE: {error}") from error

    def _handshake(self, names: list[str], frequency_hz: float, deadline_s: float) -> None:
        if self._ask(_VERSION, struct.pack(">H", _PROTOCOL), deadline_s)[:1] != _ACCEPTED:
            raise DeviceRefused(
                f"{self._where} refuses RTDE protocol {_PROTOCOL}; update PolyScope"
            )
        version = ".".join(map(str, struct.unpack(">4I", self._ask(_CONTROLLER, b"", deadline_s))))
        recipe = struct.pack(">d", frequency_hz) + ",".join(names).encode()
        reply = self._ask(_OUTPUTS, recipe, deadline_s)
        self._recipe_id, types = reply[0], reply[1:].decode().split(",")
        missing = [name for name, kind in zip(names, types, strict=False) if kind not in _FORMATS]
        if missing or len(types) != len(names):
            raise DeviceRefused(
                f"{self._where} (version {version}) has no "
                f"{', '.join(missing) or 'such outputs'}; PolyScope 3.12.3 or 5.5.1 is needed"
            )
        self._layout = struct.Struct(">" + "".join(_FORMATS[kind] for kind in types))
        if self._ask(_START, b"", deadline_s)[:1] != _ACCEPTED:
            raise DeviceRefused(f"{self._where} does not start its RTDE stream")

    def _ask(self, kind: int, payload: bytes, deadline_s: float) -> bytes:
        """Send a request and return its answer; text messages in between are skipped."""
        try:
            self._socket.sendall(_HEADER.pack(_HEADER.size + len(payload), kind) + payload)
            while True:
                reply_kind, reply = self._packet(deadline_s)
                if reply_kind == kind:
                    return reply
        except TimeoutError as error:
            raise DeviceUnavailable(
                f"{self._where} accepts connections but does not answer; restart its controller"
            ) from error
        except OSError as error:
            raise DeviceUnavailable(f"{self._where} closed the connection: {error}") from error

    def _packet(self, deadline_s: float) -> tuple[int, bytes]:
        """Next packet; TimeoutError after the deadline (nothing is lost), OSError at the end."""
        while True:
            if len(self._buffer) >= _HEADER.size:
                size, kind = _HEADER.unpack_from(self._buffer)
                if size < _HEADER.size:
                    raise DeviceRefused(f"{self._where} does not speak RTDE")
                if len(self._buffer) >= size:
                    payload = bytes(self._buffer[_HEADER.size : size])
                    del self._buffer[:size]
                    return kind, payload
            wait_s = deadline_s - self._clock.monotonic()
            if wait_s <= 0.0:
                raise TimeoutError
            self._socket.settimeout(wait_s)
            data = self._socket.recv(_READ_BYTES)
            if not data:
                raise ConnectionResetError("end of stream")
            self._buffer += data

    def sample(self, timeout_s: float) -> RtdeSample | None:
        """Next sample, None when none came; DeviceUnavailable when the connection has ended."""
        deadline_s = self._clock.monotonic() + timeout_s
        try:
            while True:
                kind, payload = self._packet(deadline_s)
                if kind == _DATA and payload[:1] == bytes([self._recipe_id]):
                    break
        except TimeoutError:
            return None
        except OSError as error:
            raise DeviceUnavailable(f"{self._where} closed the connection: {error}") from error
        values = self._layout.unpack(payload[1:])
        return RtdeSample(values[0], self._clock.monotonic(), values[1:7], values[7:13])

    def close(self) -> None:
        """End the connection, also under a reader."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


class OffsetTrack:
    """Recent samples of a connection, received by a thread that ends with `close`.

    When the controller's clock jumps (back, or ahead of the time that passed here), all samples are
    forgotten: a sample before the jump is never paired with one after it.
    """

    def __init__(self, connection: RtdeConnection) -> None:
        self._connection = connection
        self._samples: deque[RtdeSample] = deque(maxlen=_SAMPLES)
        self._mapping = ClockMapping()
        self._count = 0
        self._failure: DeviceError | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="rtde", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._failure:
                sample = self._connection.sample(_WAKE_S)
                if sample:
                    self._take(sample)
        except (DeviceError, struct.error) as error:
            with self._changed:
                self._failure = DeviceUnavailable(str(error))
                self._changed.notify_all()

    def _take(self, sample: RtdeSample) -> None:
        with self._changed:
            if self._samples:
                last = self._samples[-1]
                step_s = sample.controller_s - last.controller_s
                if step_s == 0.0:
                    return
                if step_s < 0.0 or step_s > sample.received_s - last.received_s + _JUMP_S:
                    self._samples.clear()
                    self._mapping.reset()
            self._samples.append(sample)
            self._mapping.add(sample.controller_s, sample.received_s)
            self._count += 1
            self._changed.notify_all()

    def wait_next(self, timeout_s: float) -> bool:
        """Wait for another sample, False after `timeout_s`.

        DeviceUnavailable when the link has ended.
        """
        with self._changed:
            count = self._count
            advanced = self._changed.wait_for(
                lambda: self._failure is not None or self._count > count, timeout_s
            )
            self._check()
            return advanced

    def around(self, controller_s: float, timeout_s: float) -> tuple[RtdeSample, ...]:
        """Last sample before `controller_s`, the sample of that time (if any), and the first after it.

        BadReading when this stream has no such samples, DeviceUnavailable when it has stopped.
        """
        with self._changed:
            limit = self._count + _PATIENCE
            covered = self._changed.wait_for(
                lambda: (
                    self._failure is not None
                    or self._count >= limit
                    or bool(self._samples and self._samples[-1].controller_s > controller_s)
                ),
                timeout_s,
            )
            self._check()
            if not covered:
                raise DeviceUnavailable(f"no data from the controller for {timeout_s:.2f} s")
            samples = list(self._samples)
        before = [s for s in samples if s.controller_s < controller_s][-1:]
        equal = [s for s in samples if s.controller_s == controller_s]
        after = [s for s in samples if s.controller_s > controller_s][:1]
        if not (before and after):
            raise BadReading(f"no TCP offset is known for controller time {controller_s:.3f} s")
        return (*before, *equal, *after)

    def cell_s(self, controller_s: float) -> float:
        """Cell clock at a time of the controller's clock (minimum-delay mapping)."""
        with self._changed:
            return self._mapping.cell_s(controller_s)

    def _check(self) -> None:
        if self._failure:
            raise self._failure

    def close(self) -> None:
        """End the connection and the thread; may be called more than once."""
        with self._changed:
            self._failure = self._failure or DeviceUnavailable("the driver was closed")
            self._changed.notify_all()
        self._connection.close()
        self._thread.join()
