"""From Modbus requests to answers: functions 1-6, 15, 16, 22 and 23 over data held elsewhere.

Every request is answered, and every byte judged. A frame that is not Modbus closes its connection: the next
"frame" might be the tail of this one.
"""

import struct
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from vgrd.clock import Clock
from vgrd.gate.connection import NOT_WHOLE, GarbageError
from vgrd.gate.server import Language

# All numbers of this file: Modbus Application Protocol Specification V1.1b3, chapters 6 and 7.
ILLEGAL_FUNCTION: Final = 1  # V1.1b3, 7
ILLEGAL_ADDRESS: Final = 2  # V1.1b3, 7
ILLEGAL_VALUE: Final = 3  # V1.1b3, 7
EXCEPTION_BIT: Final = 0x80  # V1.1b3, 7: of the function code in an answer that refuses
_MOST_READ_BITS: Final = 2000  # V1.1b3, 6.1 and 6.2: functions 1 and 2
_MOST_READ_REGISTERS: Final = 125  # V1.1b3, 6.3, 6.4 and 6.17: functions 3, 4 and 23
_MOST_WRITTEN_COILS: Final = 1968  # V1.1b3, 6.11: function 15
_MOST_WRITTEN_REGISTERS: Final = 123  # V1.1b3, 6.12: function 16
_MOST_EXCHANGED_REGISTERS: Final = 121  # V1.1b3, 6.17: written by function 23
_COIL_OFF: Final = 0x0000  # V1.1b3, 6.5: the two values that function 5 may write
_COIL_ON: Final = 0xFF00  # V1.1b3, 6.5
_HEADER: Final = struct.Struct(">HHHB")  # transaction, protocol, length, unit id
_ADDRESS_COUNT: Final = struct.Struct(">HH")  # of a read
_BEFORE_LENGTH: Final = 6  # bytes that the length does not count: transaction, protocol, length
_FUNCTION_AT: Final = _HEADER.size  # the byte of a frame that says what is wanted
_READS: Final = b"\1\2\3\4"  # functions that write nothing, and so start nothing
_PER_TURN: Final = 8  # reads, or one write: some 0.1 ms, as long as a read of another peer waits
_BUFFER_BYTES: Final = 4096  # chosen: fifteen of the longest frames may wait for their turn
_LONGEST: Final = 254  # unit id and the longest PDU: 253 bytes (Modbus protocol V1.1b3, 4.1)


class Data(Protocol):
    """The data behind the server. None or False: there is no such address."""

    def read_registers(self, address: int, count: int) -> bytes | None:
        """Read holding and input registers, big-endian."""
        ...

    def write_registers(self, address: int, data: bytes) -> bool:
        """Take a whole write before anything else happens."""
        ...

    def read_coils(self, address: int, count: int) -> Sequence[bool] | None:
        """Read coils."""
        ...

    def write_coils(self, address: int, values: Sequence[bool]) -> bool:
        """Set coils."""
        ...

    def read_inputs(self, address: int, count: int) -> Sequence[bool] | None:
        """Read discrete inputs."""
        ...


class _RefusedError(Exception):
    """The request is answered with an exception code."""

    def __init__(self, code: int) -> None:
        self.code = code


class ModbusFrames:
    """What one Modbus connection says: each frame is answered, whatever its unit id."""

    def __init__(self, data: Data, counters: Counter[str], clock: Clock) -> None:
        del clock
        self.data, self.requests = data, 0
        self._counters = counters

    def is_quick(self, received: bytes) -> bool:
        """Whether the first frame only reads, as far as it is there."""
        return len(received) <= _FUNCTION_AT or received[_FUNCTION_AT] in _READS

    def answer(self, received: bytes) -> tuple[bytes, int, bool]:
        """The answer to the first frame, if that is whole. Raises GarbageError."""
        if len(received) < _HEADER.size:
            return NOT_WHOLE
        transaction, protocol, length, unit = _HEADER.unpack_from(received)
        if protocol or not 2 <= length <= _LONGEST:
            raise GarbageError
        end = _BEFORE_LENGTH + length
        if end > len(received):
            return NOT_WHOLE
        answer = respond(self.data, received[_HEADER.size : end])
        self.requests += 1
        self._counters["requests"] += 1
        if answer[0] >= EXCEPTION_BIT:
            self._counters["exceptions"] += 1
        framed = _HEADER.pack(transaction, 0, 1 + len(answer), unit) + answer
        return framed, end, received[_FUNCTION_AT] not in _READS


def respond(data: Data, pdu: bytes) -> bytes:
    """Answer one PDU: function code and what follows it. Raises GarbageError."""
    try:
        return pdu[:1] + _HANDLERS.get(pdu[0], _unknown)(data, pdu[1:])
    except _RefusedError as refused:
        return bytes((pdu[0] | EXCEPTION_BIT, refused.code))


def _fixed(body: bytes, form: str) -> tuple[int, ...]:
    if len(body) != struct.calcsize(form):
        raise GarbageError
    return struct.unpack(form, body)


def _counted(body: bytes, form: str) -> tuple[tuple[int, ...], bytes]:
    """Split off the fixed part, whose last byte counts the bytes that follow."""
    head = struct.calcsize(form)
    if len(body) < head or len(body) != head + body[head - 1]:
        raise GarbageError
    return struct.unpack_from(form, body), body[head:]


def _check_count(count: int, limit: int) -> None:
    if not 1 <= count <= limit:
        raise _RefusedError(ILLEGAL_VALUE)


def _check_address(exists: bool) -> None:
    if not exists:
        raise _RefusedError(ILLEGAL_ADDRESS)


def _bits(values: Sequence[bool] | None) -> bytes:
    if values is None:
        raise _RefusedError(ILLEGAL_ADDRESS)
    size = (len(values) + 7) // 8
    number = sum(1 << i for i, value in enumerate(values) if value)
    return bytes((size,)) + number.to_bytes(size, "little")


def _words(registers: bytes | None) -> bytes:
    if registers is None:
        raise _RefusedError(ILLEGAL_ADDRESS)
    return bytes((len(registers),)) + registers


def _unknown(data: Data, body: bytes) -> bytes:  # noqa: ARG001
    raise _RefusedError(ILLEGAL_FUNCTION)


def _read_coils(data: Data, body: bytes) -> bytes:
    address, count = _fixed(body, ">HH")
    _check_count(count, _MOST_READ_BITS)
    return _bits(data.read_coils(address, count))


def _read_inputs(data: Data, body: bytes) -> bytes:
    address, count = _fixed(body, ">HH")
    _check_count(count, _MOST_READ_BITS)
    return _bits(data.read_inputs(address, count))


def _read_registers(data: Data, body: bytes) -> bytes:
    """What robots do most: nothing is computed twice."""
    try:
        address, count = _ADDRESS_COUNT.unpack(body)
    except struct.error:
        raise GarbageError from None
    _check_count(count, _MOST_READ_REGISTERS)
    return _words(data.read_registers(address, count))


def _write_coil(data: Data, body: bytes) -> bytes:
    address, value = _fixed(body, ">HH")
    if value not in (_COIL_OFF, _COIL_ON):
        raise _RefusedError(ILLEGAL_VALUE)
    _check_address(data.write_coils(address, [value == _COIL_ON]))
    return body


def _write_register(data: Data, body: bytes) -> bytes:
    address, _ = _fixed(body, ">HH")
    _check_address(data.write_registers(address, body[2:]))
    return body


def _write_coils(data: Data, body: bytes) -> bytes:
    (address, count, size), packed = _counted(body, ">HHB")
    _check_count(count, _MOST_WRITTEN_COILS)
    if size != (count + 7) // 8:
        raise _RefusedError(ILLEGAL_VALUE)
    number = int.from_bytes(packed, "little")
    _check_address(data.write_coils(address, [bool(number >> i & 1) for i in range(count)]))
    return body[:4]


def _write_registers(data: Data, body: bytes) -> bytes:
    (address, count, size), registers = _counted(body, ">HHB")
    _check_count(count, _MOST_WRITTEN_REGISTERS)
    if size != 2 * count:
        raise _RefusedError(ILLEGAL_VALUE)
    _check_address(data.write_registers(address, registers))
    return body[:4]


def _mask_register(data: Data, body: bytes) -> bytes:
    address, and_mask, or_mask = _fixed(body, ">HHH")
    old = data.read_registers(address, 1)
    if old is None:
        raise _RefusedError(ILLEGAL_ADDRESS)
    (word,) = struct.unpack(">H", old)
    _check_address(
        data.write_registers(address, struct.pack(">H", word & and_mask | or_mask & ~and_mask))
    )
    return body


def _read_write_registers(data: Data, body: bytes) -> bytes:
    (read_address, read_count, address, count, size), registers = _counted(body, ">HHHHB")
    _check_count(read_count, _MOST_READ_REGISTERS)
    _check_count(count, _MOST_EXCHANGED_REGISTERS)
    if size != 2 * count:
        raise _RefusedError(ILLEGAL_VALUE)
    if data.read_registers(read_address, read_count) is None:
        raise _RefusedError(ILLEGAL_ADDRESS)
    _check_address(data.write_registers(address, registers))
    return _words(data.read_registers(read_address, read_count))


_HANDLERS: Final[dict[int, Callable[[Data, bytes], bytes]]] = {  # V1.1b3, 6: function codes
    1: _read_coils,
    2: _read_inputs,
    3: _read_registers,
    4: _read_registers,
    5: _write_coil,
    6: _write_register,
    15: _write_coils,
    16: _write_registers,
    22: _mask_register,
    23: _read_write_registers,
}

MODBUS: Final = Language[Data]("Modbus", "port", ModbusFrames, _BUFFER_BYTES, _PER_TURN)
