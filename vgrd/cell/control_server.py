"""The control API: newline-delimited JSON on a Unix socket, one reply per request, `subscribe` for events."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import structlog

from vgrd.errors import ControlError, VgrdError
from vgrd.ipc.messages import decode_line, encode_line

Arguments = Mapping[str, Any]
Operation = Callable[[Arguments], Awaitable[Mapping[str, Any]]]
LINE_LIMIT = 1 << 20
EVENT_BACKLOG = 100

log = structlog.get_logger()


class ControlServer:
    """Serves `operations` by name; everything that raises VgrdError is answered, never fatal."""

    def __init__(self, path: Path, operations: Mapping[str, Operation]) -> None:
        self.path = path
        self.operations = operations
        self.listeners: set[asyncio.Queue[Mapping[str, Any]]] = set()

    async def serve(self) -> None:
        """Listen until cancelled."""
        self.path.unlink(missing_ok=True)
        server = await asyncio.start_unix_server(self._client, str(self.path), limit=LINE_LIMIT)
        self.path.chmod(0o660)
        async with server:
            await server.serve_forever()

    def emit(self, event: str, **fields: object) -> None:
        """Tell every subscriber; a subscriber that does not read loses events, nobody waits for it."""
        for queue in self.listeners:
            with contextlib.suppress(asyncio.QueueFull):
                queue.put_nowait({"event": event, **fields})

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await reader.readline():
                await self._serve_line(line, writer)
        except (ConnectionError, ValueError) as err:
            log.info("control_client_lost", reason=str(err))
        finally:
            writer.close()

    async def _serve_line(self, line: bytes, writer: asyncio.StreamWriter) -> None:
        request: Mapping[str, Any] = {}
        try:
            request = decode_line(line)
            if request.get("op") == "subscribe":
                await self._stream_events(request, writer)
                return
            reply = await self._perform(request)
        except VgrdError as err:
            reply = {"ok": False, "error": type(err).__name__, "message": str(err)}
        writer.write(encode_line({"id": request.get("id"), **reply}))
        await writer.drain()

    async def _perform(self, request: Mapping[str, Any]) -> dict[str, Any]:
        name = request.get("op")
        operation = self.operations.get(str(name))
        if operation is None:
            known = ", ".join(sorted(self.operations))
            raise ControlError(f"unknown operation {name!r}; known are: {known}")
        arguments = {key: value for key, value in request.items() if key not in ("op", "id")}
        return {"ok": True, "result": await operation(arguments)}

    async def _stream_events(
        self, request: Mapping[str, Any], writer: asyncio.StreamWriter
    ) -> None:
        queue: asyncio.Queue[Mapping[str, Any]] = asyncio.Queue(EVENT_BACKLOG)
        self.listeners.add(queue)
        try:
            writer.write(encode_line({"id": request.get("id"), "ok": True, "result": {}}))
            while True:
                await writer.drain()
                writer.write(encode_line(dict(await queue.get())))
        finally:
            self.listeners.discard(queue)


def text_argument(arguments: Arguments, name: str, default: str | None = None) -> str:
    """A string argument of a request; ControlError when it is missing or of another type."""
    value = arguments.get(name, default)
    if not isinstance(value, str):
        raise ControlError(f"argument {name!r} must be a text, got {value!r}")
    return value
