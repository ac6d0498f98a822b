"""The server against pymodbus's client as oracle, and against raw bytes."""

import asyncio
import contextlib
import errno
import random
import socket
import struct
import threading
import time
from dataclasses import replace

import pytest
from pymodbus.client import ModbusTcpClient

from fakes.controllers.raw_modbus import RawModbus
from vgrd.clock import SystemClock
from vgrd.errors import ServingError
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.modbus import ACCEPTS_PER_TURN, ConnectionLimits, ModbusServer
from vgrd.gate.register_bank import RegisterBank
from vgrd.registers import Status

LIMITS = ConnectionLimits(
    allow=("127.0.0.0/30",), connections_per_peer=4, idle_s=0.6, partial_s=0.2, silent_s=0.2
)


class ServerThread:
    """The server with a desk behind it, in an event loop of its own."""

    def __init__(self, runtime_dir, limits=LIMITS):
        clock = SystemClock()
        feed = ImageFeed(runtime_dir, clock)
        self.bank = RegisterBank(
            feed, clock, deadline_s=0.25, forward=lambda _: True, abort=lambda: None
        )
        self.server = ModbusServer(self.bank, clock, limits)
        self.loop = asyncio.new_event_loop()
        self.port = self.loop.run_until_complete(self.server.listen("127.0.0.1", 0))
        self.sweep()
        self.thread = threading.Thread(target=self.loop.run_forever)

    def sweep(self):
        """As the gate does."""
        self.server.sweep()
        self.loop.call_later(0.05, self.sweep)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.loop.call_soon_threadsafe(self.server.close)
        self.loop.call_soon_threadsafe(self.loop.call_later, 0.02, self.loop.stop)
        self.thread.join()
        self.loop.close()

    def client(self, **more) -> RawModbus:
        """Connect."""
        return RawModbus("127.0.0.1", self.port, **more)


@pytest.fixture
def serving(tmp_path):
    with ServerThread(tmp_path) as made:
        yield made


@pytest.fixture
def oracle(serving):
    client = ModbusTcpClient("127.0.0.1", port=serving.port, timeout=2, retries=0)
    assert client.connect()
    yield client
    client.close()


def is_closed(client: RawModbus, within_s: float = 3.0) -> bool:
    """Whether the server closes the connection without another word."""
    client.socket.settimeout(within_s)
    try:
        return client.socket.recv(100) == b""
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False


def test_the_oracle_reads_the_response_in_both_register_spaces(oracle):
    for read in (oracle.read_holding_registers, oracle.read_input_registers):
        registers = read(100, count=68).registers
        assert len(registers) == 68
        assert registers[0] == 0x0100
        assert registers[4] == Status.STARTING
        assert registers[20:26] == [0x8000] * 6


def test_the_oracle_reads_back_what_it_writes(oracle):
    assert not oracle.write_registers(1, [1, 2, 3]).isError()
    assert not oracle.write_register(4, 77).isError()
    assert not oracle.mask_write_register(address=4, and_mask=0xF0, or_mask=0x05).isError()
    assert oracle.read_holding_registers(1, count=4).registers == [1, 2, 3, 77 & 0xF0 | 0x05]
    both = oracle.readwrite_registers(
        read_address=1, read_count=2, write_address=2, values=[9, 8], device_id=1
    )
    assert both.registers == [1, 9]


def test_the_oracle_sees_coils_and_inputs(oracle):
    assert not oracle.write_coil(0, True).isError()
    assert oracle.read_coils(0, count=2).bits[:2] == [True, False]
    assert not oracle.write_coils(0, [False, True]).isError()
    assert oracle.read_coils(0, count=2).bits[:2] == [False, True]
    assert oracle.read_discrete_inputs(0, count=17).bits[:17].count(True) >= 1


@pytest.mark.parametrize("unit", [0, 1, 2, 247, 255])
def test_every_unit_id_is_answered_with_itself(serving, unit):
    with serving.client() as client:
        client.send(struct.pack(">BHH", 4, 100, 1), unit)
        assert client.receive() == (1, unit, b"\x04\x02\x01\x00")


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        (struct.pack(">BHH", 3, 100, 0), 3),
        (struct.pack(">BHH", 3, 100, 126), 3),
        (struct.pack(">BHH", 4, 100, 0xFFFF), 3),
        (struct.pack(">BHH", 3, 99, 2), 2),
        (struct.pack(">BHH", 3, 65535, 125), 2),
        (struct.pack(">BHH", 1, 0, 3), 2),
        (struct.pack(">BHH", 1, 0, 2001), 3),
        (struct.pack(">BHH", 2, 17, 1), 2),
        (struct.pack(">BHH", 5, 0, 0x1234), 3),
        (struct.pack(">BHH", 5, 2, 0xFF00), 2),
        (struct.pack(">BHH", 6, 100, 1), 2),
        (struct.pack(">BHHBB", 15, 0, 9, 1, 0), 3),
        (struct.pack(">BHHBH", 15, 0, 9, 2, 0), 2),
        (struct.pack(">BHHBH", 16, 0, 2, 2, 0), 3),
        (struct.pack(">BHHB", 16, 0, 0, 0), 3),
        (struct.pack(">BHHBH", 16, 120, 1, 2, 5), 2),
        (struct.pack(">BHHH", 22, 100, 1, 1), 2),
        (struct.pack(">BHHHHBH", 23, 99, 2, 0, 1, 2, 5), 2),
        (struct.pack(">BHHHHBH", 23, 0, 126, 0, 1, 2, 5), 3),
        (b"\x07", 1),
        (b"\x2b\x0e\x01\x00", 1),
        (b"\x00", 1),
    ],
    ids=lambda value: value.hex() if isinstance(value, bytes) else str(value),
)
def test_a_refused_request_gets_its_function_and_the_right_code(serving, pdu, code):
    with serving.client() as client:
        assert client.call(pdu) == bytes((pdu[0] | 0x80, code))
        assert client.read(100, 1) == b"\x01\x00"
        assert serving.bank.read_registers(0, 32) == bytes(64)


def test_every_one_of_many_pipelined_requests_is_answered_in_order(serving):
    with serving.client() as client:
        frames = b"".join(
            struct.pack(">HHHBBHH", i, 0, 6, 1, 4, 100 + i % 60, 2) for i in range(2000)
        )
        threading.Thread(target=client.socket.sendall, args=(frames,)).start()
        assert [client.receive()[0] for _ in range(2000)] == list(range(2000))


def test_a_request_cut_into_single_bytes_is_answered(serving):
    with serving.client() as client:
        for byte in struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 100, 1):
            client.socket.sendall(bytes((byte,)))
        assert client.receive()[2] == b"\x04\x02\x01\x00"


def test_a_write_is_in_force_before_it_is_answered(serving):
    with serving.client() as client:
        write = struct.pack(">BHHB", 16, 0, 3, 6) + struct.pack(">3H", 9, 2, 4)
        both = struct.pack(">BHHHHB", 23, 0, 1, 0, 1, 2) + b"\0\x0a"
        for pdu in (write, struct.pack(">BHH", 3, 103, 2), both, struct.pack(">BHH", 3, 103, 2)):
            client.send(pdu)
        answers = [client.receive()[2] for _ in range(4)]
        assert answers[1] == struct.pack(">BBHH", 3, 4, 9, Status.STARTING)
        assert answers[2] == b"\x17\x02\x00\x0a"
        assert answers[3] == struct.pack(">BBHH", 3, 4, 10, Status.STARTING)


@pytest.mark.parametrize(
    "garbage",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack(">HHHBBHH", 1, 1, 6, 1, 3, 100, 1),
        struct.pack(">HHHBB", 1, 0, 0, 1, 3),
        struct.pack(">HHHBB", 1, 0, 1, 1, 3),
        struct.pack(">HHHBB", 1, 0, 255, 1, 3),
        struct.pack(">HHHBB", 1, 0, 0xFFFF, 1, 3),
        struct.pack(">HHHBBHHB", 1, 0, 7, 1, 3, 100, 1, 0),
        struct.pack(">HHHBBHHHBHBB", 1, 0, 13, 1, 3, 100, 1, 16, 0, 1, 2, 5)[:19],
        struct.pack(">HHHBBHHBH", 1, 0, 9, 1, 16, 0, 2, 4, 5),
    ],
    ids=[
        "http",
        "protocol",
        "length 0",
        "length 1",
        "length 255",
        "length 65535",
        "tail",
        "hidden",
        "short write",
    ],
)
def test_garbage_closes_its_connection_at_once_and_no_other(serving, garbage):
    with serving.client() as good, serving.client() as bad:
        bad.socket.sendall(garbage)
        assert is_closed(bad, 0.5)
        assert good.read(100, 1) == b"\x01\x00"
        assert serving.bank.read_registers(0, 32) == bytes(64)


def test_what_comes_before_garbage_is_not_answered_half(serving):
    with serving.client() as client:
        client.send(struct.pack(">BHH", 4, 100, 1))
        assert client.receive()[2] == b"\x04\x02\x01\x00"
        client.socket.sendall(bytes(8))
        assert is_closed(client, 0.5)
        assert serving.server.counters["garbage"] == 1


def test_a_frame_that_stays_cut_and_an_idle_connection_are_closed(serving):
    with serving.client() as slow, serving.client() as idle:
        begin = time.monotonic()
        slow.socket.sendall(b"\0\1\0\0\0\6")
        assert is_closed(slow)
        assert time.monotonic() - begin < LIMITS.idle_s
        assert is_closed(idle)
        assert time.monotonic() - begin >= LIMITS.idle_s
        assert serving.server.counters["timeouts"] == 2


def test_a_client_that_does_not_take_its_answers_is_closed(serving):
    with serving.client() as client:
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        frames = struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 100, 68) * 1000
        with pytest.raises(ConnectionError):
            client.socket.sendall(frames * 1000)


def test_an_address_that_is_not_on_the_list_is_refused(serving):
    with socket.socket() as stranger:
        stranger.bind(("127.9.9.9", 0))
        stranger.settimeout(2)
        with contextlib.suppress(ConnectionResetError):
            stranger.connect(("127.0.0.1", serving.port))
            assert stranger.recv(1) == b""
    assert serving.server.counters["refused"] == 1


def test_a_peer_that_connects_without_end_starves_neither_itself_nor_another(serving):
    with contextlib.ExitStack() as stack, serving.client() as robot:
        peers = []
        for _ in range(40):
            flood = stack.enter_context(socket.socket())
            flood.bind(("127.0.0.2", 0))
            flood.connect(("127.0.0.1", serving.port))
            peers.append(flood)
        assert serving.server.connections <= 1 + LIMITS.connections_per_peer
        counters, end = serving.server.counters, time.monotonic() + 5
        while sum(counters[n] for n in ("accepted", "refused")) < 41 and time.monotonic() < end:
            assert robot.read(100, 1) == b"\x01\x00"
        assert counters["refused"] + counters["evicted"] == 40 - LIMITS.connections_per_peer


def connect_from(host: str, port: int) -> socket.socket:
    """Connect from another address of this machine."""
    link = socket.socket()
    link.settimeout(5)
    link.bind((host, 0))
    with contextlib.suppress(ConnectionResetError):
        link.connect(("127.0.0.1", port))
    return link


def test_connections_that_never_said_anything_go_before_a_robot_that_pauses(serving):
    with contextlib.ExitStack() as stack, serving.client() as robot:
        for _ in range(2):
            assert robot.read(100, 1) == b"\x01\x00"
        time.sleep(LIMITS.silent_s + 0.1)
        idle = [stack.enter_context(connect_from("127.0.0.1", serving.port)) for _ in range(100)]
        assert robot.read(100, 1) == b"\x01\x00"
        with serving.client() as newest:
            assert newest.read(100, 1) == b"\x01\x00"
        assert robot.read(100, 1) == b"\x01\x00"
        assert serving.server.counters["refused"] == 0
        assert serving.server.counters["evicted"] >= 100 - LIMITS.connections_per_peer
        del idle


def test_who_asked_once_goes_before_a_robot_that_pauses(serving):
    with contextlib.ExitStack() as stack, serving.client() as robot:
        for _ in range(2):
            assert robot.read(100, 1) == b"\x01\x00"
        time.sleep(LIMITS.silent_s + 0.1)
        for _ in range(20):
            assert stack.enter_context(serving.client()).read(100, 1) == b"\x01\x00"
        assert robot.read(100, 1) == b"\x01\x00"


def test_connections_that_all_poll_are_not_given_up_for_one_more(tmp_path):
    with (
        ServerThread(tmp_path, replace(LIMITS, silent_s=60.0)) as serving,
        contextlib.ExitStack() as stack,
    ):
        full = [stack.enter_context(serving.client()) for _ in range(LIMITS.connections_per_peer)]
        for client in full * 2:
            assert client.read(100, 1) == b"\x01\x00"
        with contextlib.suppress(ConnectionResetError), serving.client() as one_more:
            assert is_closed(one_more)  # unless it was closed before it was even connected
        for client in full:
            assert client.read(100, 1) == b"\x01\x00"
        assert serving.server.counters["refused"] == 1
        assert serving.server.counters["evicted"] == 0


def test_in_a_full_house_the_peer_with_most_connections_makes_room(tmp_path):
    limits = replace(LIMITS, allow=("127.0.0.0/8",), connections=6, connections_per_peer=4)
    with ServerThread(tmp_path, limits) as serving, contextlib.ExitStack() as stack:
        robot = stack.enter_context(serving.client())
        assert robot.read(100, 1) == b"\x01\x00"
        for host in ("127.0.0.2",) * 4 + ("127.0.0.3",) * 4:
            stack.enter_context(connect_from(host, serving.port))
        late = stack.enter_context(connect_from("127.0.0.4", serving.port))
        late.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 100, 1))
        assert late.recv(100)[-2:] == b"\x01\x00"
        assert robot.read(100, 1) == b"\x01\x00"
        assert serving.server.connections <= 6
        assert serving.server.counters["refused"] == 0


class Turns:
    """The server in a loop that the test turns by hand."""

    def __init__(self, runtime_dir):
        clock = SystemClock()
        bank = RegisterBank(
            ImageFeed(runtime_dir, clock),
            clock,
            deadline_s=0.25,
            forward=lambda _: True,
            abort=lambda: None,
        )
        self.loop = asyncio.new_event_loop()
        self.server = ModbusServer(bank, clock, LIMITS)
        self.port = self.loop.run_until_complete(self.server.listen("127.0.0.1", 0))

    def turn(self) -> None:
        """Let the loop look at its sockets once."""
        self.loop.call_soon(self.loop.stop)
        self.loop.run_forever()

    def close(self) -> None:
        async def end() -> None:
            self.server.close()

        self.loop.run_until_complete(end())
        self.loop.close()


@pytest.fixture
def turns(tmp_path):
    made = Turns(tmp_path)
    yield made
    made.close()


def test_a_listed_robot_behind_a_crowd_of_strangers_is_let_in_after_a_few_turns(turns):
    """All of them wait in the queue of the kernel, which must hold them; time does not count."""
    with contextlib.ExitStack() as stack:
        crowd = 3 * ACCEPTS_PER_TURN
        for _ in range(crowd):
            stack.enter_context(connect_from("127.9.9.9", turns.port))
        stack.enter_context(connect_from("127.0.0.1", turns.port))
        refused = 0
        for _ in range(8):
            turns.turn()
            before, refused = refused, turns.server.counters["refused"]
            assert refused - before <= ACCEPTS_PER_TURN
        assert refused == crowd
        assert turns.server.connections == 1


def test_a_socket_that_listens_already_is_served_with_a_queue_of_our_length(tmp_path):
    clock = SystemClock()
    feed = ImageFeed(tmp_path, clock)
    bank = RegisterBank(feed, clock, deadline_s=0.25, forward=lambda _: True, abort=lambda: None)

    async def serve() -> None:
        server = ModbusServer(bank, clock, LIMITS)
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


def test_without_descriptors_the_server_rests_and_accepts_again_later(turns, monkeypatch):
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

    listener = Short(turns.server._listeners[0])
    turns.server._listeners = [listener]

    async def sweep() -> None:
        turns.server.sweep()

    async def listen() -> None:
        turns.server._wait_for_peers(listener)

    turns.loop.run_until_complete(listen())
    with connect_from("127.0.0.1", turns.port):
        for _ in range(50):
            turns.turn()
        assert listener.calls == 1
        listener.short = False
        turns.loop.run_until_complete(sweep())
        for _ in range(4):
            turns.turn()
        assert turns.server.connections == 1


def test_a_robot_that_comes_back_takes_the_place_of_its_silent_connections(serving):
    with contextlib.ExitStack() as stack:
        for _ in range(LIMITS.connections_per_peer):
            stack.enter_context(serving.client())
        time.sleep(LIMITS.silent_s + 0.05)
        back = stack.enter_context(serving.client())
        assert back.read(100, 1) == b"\x01\x00"
        assert serving.server.counters["evicted"] == 1


def test_a_port_that_is_taken_is_named_with_the_remedy(serving):
    second = ModbusServer(serving.bank, SystemClock(), LIMITS)
    with pytest.raises(ServingError, match=rf"127.0.0.1:{serving.port}.*\[serving\] port"):
        asyncio.run(second.listen("127.0.0.1", serving.port))
    with pytest.raises(ServingError, match=r"does not have that address.*\[serving\] host"):
        asyncio.run(second.listen("192.0.2.1", 0))


def test_random_bytes_and_mutated_requests_leave_the_server_serving(serving):
    random_numbers = random.Random(5)
    valid = [
        struct.pack(">HHHBBHH", 7, 0, 6, 1, 3, 100, 68),
        struct.pack(">HHHBBHHBHH", 7, 0, 11, 1, 16, 0, 2, 4, 1, 2),
        struct.pack(">HHHBBHHHHBH", 7, 0, 13, 1, 23, 100, 2, 0, 1, 2, 5),
        struct.pack(">HHHBBHHBB", 7, 0, 8, 1, 15, 0, 2, 1, 3),
    ]
    client = serving.client(timeout_s=1.0)
    for _ in range(1500):
        frame = bytearray(random_numbers.choice(valid))
        for _ in range(random_numbers.randrange(4)):
            frame[random_numbers.randrange(len(frame))] = random_numbers.randrange(256)
        if random_numbers.random() < 0.1:
            frame = random_numbers.randbytes(random_numbers.randrange(1, 400))
        client.socket.sendall(frame)
        client.socket.settimeout(0.002)
        try:
            if client.socket.recv(65536) == b"":
                raise ConnectionResetError
        except TimeoutError:
            continue
        except ConnectionError:
            client.socket.close()
            client = serving.client(timeout_s=1.0)
    client.socket.close()
    with serving.client() as fresh:
        assert fresh.read(100, 1) == b"\x01\x00"
        assert len(fresh.read(100, 68)) == 136
