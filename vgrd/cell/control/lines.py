"""What clients of the control socket say, line by line, and what they are told."""

import asyncio
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from vgrd.errors import ControlError, InternalError, VgrdError
from vgrd.ipc.messages import decode_line, encode_line

Arguments = Mapping[str, Any]
_CHUNK_BYTES = 1 << 16  # as `request_bytes`: one read takes the longest request
_LONGEST_ID = 100  # characters; it comes back with the reply
_SHOWN = 60  # characters of a wrong value in a message


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """What clients of the control socket may do; all of them are programs on this machine."""

    clients: int = 32  # a page, a few terminals and scripts; a descriptor each
    request_bytes: int = 1 << 16  # the longest request has a few hundred
    idle_s: float = 60.0  # a client that asks nothing for so long has forgotten its connection
    line_s: float = 5.0  # for the rest of a request: programs write them in one piece
    taking_s: float = 5.0  # for taking a reply: a person may have stopped the program for a moment


class Lines:
    """Splits what comes into lines."""

    def __init__(self, reader: asyncio.StreamReader, limits: ControlLimits) -> None:
        self._reader = reader
        self._limits = limits
        self._buffer = b""

    async def next(self) -> bytes | None:
        """The next line without its end, None when the client has ended.

        Raises ControlError for a line that is too long or never ends, TimeoutError for silence.
        """
        if not self._buffer:
            async with asyncio.timeout(self._limits.idle_s):
                self._buffer = await self._reader.read(_CHUNK_BYTES)
            if not self._buffer:
                return None
        try:
            async with asyncio.timeout(self._limits.line_s):
                await self._complete()
        except TimeoutError as err:
            raise ControlError(
                f"the request was not complete within {self._limits.line_s:g} s: end it with a newline"
            ) from err
        line, _, self._buffer = self._buffer.partition(b"\n")
        self._check_size(line)
        return line

    async def _complete(self) -> None:
        """Read until a whole line is there."""
        while b"\n" not in self._buffer:
            self._check_size(self._buffer)
            chunk = await self._reader.read(_CHUNK_BYTES)
            if not chunk:
                raise ControlError("the request was cut short: end it with a newline")
            self._buffer += chunk

    def _check_size(self, line: bytes) -> None:
        if len(line) > self._limits.request_bytes:
            raise ControlError(
                f"a request of more than {self._limits.request_bytes} bytes is not taken"
            )


@dataclass(frozen=True, slots=True)
class Asked:
    """A request that is one: id is what the reply repeats, or None."""

    id: str | int | None
    op: str
    arguments: Arguments

    @classmethod
    def parse(cls, line: bytes) -> Self:
        """Raises ControlError for what is no request."""
        message = decode_line(line)
        number, op = message.pop("id", None), message.pop("op", None)
        if (
            not isinstance(number, str | int | None)
            or isinstance(number, bool)
            or len(str(number)) > _LONGEST_ID
        ):
            raise ControlError(
                f"id {shown(number)}: a text or a whole number of at most {_LONGEST_ID} characters"
            )
        if not isinstance(op, str):
            raise ControlError(f"op must be the name of an operation, got {shown(op)}")
        return cls(number, op, message)


def accepted(number: str | int | None, result: Mapping[str, Any]) -> bytes:
    """Line of a reply. Raises InternalError for a result that JSON cannot hold."""
    try:
        return encode_line({"id": number, "ok": True, "result": dict(result)})
    except ControlError as err:
        raise InternalError.of("the reply", err) from err


def refused(number: str | int | None, error: VgrdError) -> bytes:
    """Line of a reply that tells an error by its name and its message."""
    name = error.error if isinstance(error, ControlError) else type(error).__name__
    return encode_line({"id": number, "ok": False, "error": name, "message": str(error)})


def text_argument(arguments: Arguments, name: str, default: str | None = None) -> str:
    """A text among the arguments; ControlError when it is missing or of another type."""
    value = arguments.get(name, default)
    if not isinstance(value, str):
        raise ControlError(f"argument {name!r} must be a text, got {shown(value)}")
    return value


def optional_text(arguments: Arguments, name: str) -> str | None:
    """A text, or None where it is left out; ControlError for another type."""
    return None if arguments.get(name) is None else text_argument(arguments, name)


def flag_argument(arguments: Arguments, name: str, *, default: bool) -> bool:
    """True or false; the default where it is left out, ControlError for another type."""
    value = arguments.get(name)
    if value is None:
        return default
    if not isinstance(value, bool):
        raise ControlError(f"argument {name!r} must be true or false, got {shown(value)}")
    return value


def optional_number(arguments: Arguments, name: str) -> float | None:
    """A finite number, also written as a text, or None where it is left out; else ControlError."""
    value = arguments.get(name)
    if value is None:
        return None
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if math.isfinite(number):
            return number
    raise ControlError(f"argument {name!r} must be a number, got {shown(value)}")


def optional_whole(arguments: Arguments, name: str) -> int | None:
    """A whole number, also written as a text, or None where it is left out; else ControlError."""
    number = optional_number(arguments, name)
    if number is None or number.is_integer():
        return None if number is None else int(number)
    raise ControlError(f"argument {name!r} must be a whole number, got {shown(arguments[name])}")


def whole_argument(arguments: Arguments, name: str) -> int:
    """The same of one that must be there."""
    number = optional_whole(arguments, name)
    if number is None:
        raise ControlError(f"argument {name!r} must be a whole number, and is missing")
    return number


def shown(value: object) -> str:
    """A value as it is shown in a message: at most a line of it."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
