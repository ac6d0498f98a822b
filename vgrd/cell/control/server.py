"""The control API: newline-delimited JSON on a Unix socket, one reply per request."""

import asyncio
import errno
import resource
import socket
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import structlog

from vgrd.cell.control.lines import (
    Arguments,
    Asked,
    ControlLimits,
    Lines,
    accepted,
    refused,
    shown,
)
from vgrd.errors import ControlError, InternalError, VgrdError
from vgrd.permissions import take_after

_QUEUED = 64  # connections that the kernel holds until they are accepted
_RETRY_S = 0.2  # until a descriptor may be free again
_DESCRIPTOR_SHARE = 4  # the cell itself has about 30 open
_NO_DESCRIPTOR = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Operation:
    """What `perform` does with the arguments that it knows by name."""

    perform: Callable[[Arguments], Awaitable[Mapping[str, Any]]]
    arguments: tuple[str, ...] = ()


class ControlServer:
    """Serves `operations` by name; whatever a client sends or leaves out, the others are served on."""

    def __init__(
        self,
        path: Path,
        operations: Mapping[str, Operation],
        limits: ControlLimits | None = None,
    ) -> None:
        self.path = path
        self.operations = operations
        self.limits = _affordable(limits or ControlLimits())
        self.clients = 0

    async def serve(self) -> None:
        """Listen until cancelled."""
        with self._listening() as listening:
            try:
                async with asyncio.TaskGroup() as clients:
                    while True:
                        self._receive(await _accepted(listening), clients)
            finally:
                self.path.unlink(missing_ok=True)

    def _receive(self, link: socket.socket, clients: asyncio.TaskGroup) -> None:
        if self.clients >= self.limits.clients:
            self._turn_away(link)
        else:
            self.clients += 1
            clients.create_task(self._client(link))

    def _listening(self) -> socket.socket:
        self.path.unlink(missing_ok=True)
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listening.setblocking(False)
        listening.bind(str(self.path))
        take_after(self.path, self.path.parent)
        listening.listen(_QUEUED)
        return listening

    def _turn_away(self, link: socket.socket) -> None:
        refusal = ControlError(
            f"{self.limits.clients} clients are connected, more are not served: close one"
        )
        log.warning("control_client_refused", connected=self.clients)
        with link, suppress(OSError):  # it may have gone, which is as good
            link.send(refused(None, refusal))

    async def _client(self, link: socket.socket) -> None:
        """One connection, from its first request to its end, whoever ends it."""
        try:
            reader, writer = await asyncio.open_unix_connection(sock=link)
            writer.transport.set_write_buffer_limits(high=0)  # drain waits until all is taken
            try:
                await self._converse(reader, writer)
            except ControlError as err:
                await self._send(writer, refused(None, err))
            finally:
                writer.transport.abort()
        except (
            OSError
        ) as err:  # of the connection or of its time: operations answer for themselves
            log.info("control_client_lost", reason=str(err) or "silent for too long")
        finally:
            link.close()
            self.clients -= 1

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer line by line. ControlError where a line cannot be told from the next any more."""
        lines = Lines(reader, self.limits)
        while (line := await lines.next()) is not None:
            try:
                request = Asked.parse(line)
            except ControlError as err:
                await self._send(writer, refused(None, err))
                continue
            await self._send(writer, await self._reply(request))

    async def _send(self, writer: asyncio.StreamWriter, line: bytes) -> None:
        """Send; TimeoutError when the client does not take it."""
        writer.write(line)
        async with asyncio.timeout(self.limits.taking_s):
            await writer.drain()

    async def _reply(self, request: Asked) -> bytes:
        """The answer to a request; a fault of ours is told as one, logged whole, and ends nothing."""
        try:
            operation = self._operation(request)
            return accepted(request.id, await operation.perform(request.arguments))
        except VgrdError as err:
            return refused(request.id, err)
        except Exception as err:
            log.exception("operation_failed", op=request.op)
            return refused(request.id, InternalError.of(request.op, err))

    def _operation(self, request: Asked) -> Operation:
        operation = self.operations.get(request.op)
        if operation is None:
            names = ", ".join(sorted(self.operations))
            raise ControlError(f"unknown operation {shown(request.op)}; known are: {names}")
        for name in request.arguments:
            if name not in operation.arguments:
                names = ", ".join(operation.arguments) or "none"
                raise ControlError(
                    f"{request.op}: unknown argument {shown(name)}; known are: {names}"
                )
        return operation


async def _accepted(listening: socket.socket) -> socket.socket:
    """The next connection, as soon as there is a descriptor for it."""
    while True:
        try:
            link, _ = await asyncio.get_running_loop().sock_accept(listening)
        except OSError as err:
            if err.errno not in _NO_DESCRIPTOR:
                raise
            log.warning("control_client_waits", reason=err.strerror)
            await asyncio.sleep(_RETRY_S)
        else:
            return link


def _affordable(limits: ControlLimits) -> ControlLimits:
    """At most a quarter of this process's descriptors for clients, so that rings and files get theirs."""
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return replace(limits, clients=min(limits.clients, max(1, descriptors // _DESCRIPTOR_SHARE)))
