"""The listening socket: its queue, a crowd in it, no descriptors left, and an address that cannot be had."""

import asyncio
import contextlib
import errno
import socket

import pytest

from tests.gate.modbus.server import LIMITS, TurnedServers, connect_from
from vgrd.clock import SystemClock
from vgrd.errors import ServingError
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.pdu import MODBUS
from vgrd.gate.register_bank import RegisterBank
from vgrd.gate.server import ACCEPTS_PER_TURN, Server


@pytest.fixture
def server(tmp_path):
    clock = SystemClock()
    feed = ImageFeed(tmp_path, clock)
    bank = RegisterBank(feed, clock, deadline_s=0.25, forward=lambda _: True, abort=lambda: None)
    return Server(MODBUS, bank, clock, LIMITS)


@pytest.fixture
def turned(server):
    made = TurnedServers(server)
    yield made
    made.close()


def test_a_listed_robot_behind_a_crowd_of_strangers_is_let_in_after_a_few_turns(server, turned):
    """All of them wait in the queue of the kernel, which must hold them; time does not count."""
    with contextlib.ExitStack() as stack:
        crowd = 3 * ACCEPTS_PER_TURN
        for _ in range(crowd):
            stack.enter_context(connect_from("127.9.9.9", turned.ports[0]))
        stack.enter_context(connect_from("127.0.0.1", turned.ports[0]))
        refused = 0
        for _ in range(8):
            turned.turn()
            before, refused = refused, server.counters["refused"]
            assert refused - before <= ACCEPTS_PER_TURN
        assert refused == crowd
        assert server.connections == 1


def test_a_socket_that_listens_already_is_served_with_a_queue_of_our_length(server):
    async def serve() -> None:
        given = socket.create_server(("127.0.0.1", 0), backlog=1)
        port = given.getsockname()[1]
        assert await server.listen("127.0.0.1", port, given) == port
        with contextlib.ExitStack() as stack:
            for _ in range(50):
                stack.enter_context(connect_from("127.0.0.1", port))
            await asyncio.sleep(0.05)
            assert server.counters["accepted"] == 50
        server.close()

    asyncio.run(serve())


def test_without_descriptors_the_server_rests_and_accepts_again_later(server, turned):
    class Short:
        """A listener in a process that has no descriptor left."""

        def __init__(self, listener):
            self.listener, self.calls, self.short = listener, 0, True

        def fileno(self):
            return self.listener.fileno()

        def accept(self):
            self.calls += 1
            if self.short:
                raise OSError(errno.EMFILE, "Too many open files")
            return self.listener.accept()

        def close(self):
            self.listener.close()

    listener = Short(server._listeners[0])
    server._listeners = [listener]

    turned.do(lambda: server._wait_for_peers(listener))
    with connect_from("127.0.0.1", turned.ports[0]):
        for _ in range(50):
            turned.turn()
        assert listener.calls == 1
        listener.short = False
        turned.do(server.sweep)
        for _ in range(4):
            turned.turn()
        assert server.connections == 1


def test_a_port_that_is_taken_is_named_with_the_remedy(serving):
    second = Server(MODBUS, serving.bank, SystemClock(), LIMITS)
    with pytest.raises(ServingError, match=rf"127.0.0.1:{serving.port}.*\[serving\] port"):
        asyncio.run(second.listen("127.0.0.1", serving.port))
    with pytest.raises(ServingError, match=r"does not have that address.*\[serving\] host"):
        asyncio.run(second.listen("192.0.2.1", 0))
