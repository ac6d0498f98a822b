"""Lines in a loop that is turned by hand: what they do in one turn, and what time alone does to a connection."""

import contextlib
import random
import socket
from dataclasses import replace

import pytest

from fakes.controllers.raw_modbus import RawModbus
from tests.gate.modbus.server import LIMITS, TurnedServers
from tests.gate.register_bank.bench import Bench
from vgrd.gate.lines import LINES
from vgrd.gate.pdu import MODBUS
from vgrd.gate.server import Server

CLIENTS = 100
PER_PEER = 4
POLLS = b"EC,1,7\n" * 5000
ASKS = b"".join(b"EC,1,%d\n" % trig for trig in range(1, 5001))


class Turns(TurnedServers):
    """Registers and lines in one loop, on a clock that tests set."""

    def __init__(self, runtime_dir):
        bench = Bench(runtime_dir)
        bench.start_cell()
        bench.publish()
        self.clock = bench.clock
        self.bank = bench.bank
        limits = replace(LIMITS, allow=("127.0.0.0/8",), connections=CLIENTS)
        registers = Server(MODBUS, bench.bank, bench.clock, limits)
        self.lines = Server(LINES, bench.bank, bench.clock, limits)
        super().__init__(registers, self.lines)
        self.port, self.line_port = self.ports

    def answered(self) -> int:
        """Turn once; how many lines that answered."""
        return self.rise(self.lines.counters, "requests")

    def started(self) -> int:
        """Turn once; how many requests that started."""
        return self.rise(self.bank.counters, "triggers")

    def sweep_after(self, seconds: float) -> int:
        """Let time pass; how many connections the lines have then."""
        self.turn()
        self.clock.now_s += seconds
        self.do(self.lines.sweep)
        return self.lines.connections


@pytest.fixture
def turns(tmp_path):
    made = Turns(tmp_path)
    yield made
    made.close()


@pytest.fixture
def flood(turns):
    """Clients that send without end, each from an address that may have more."""
    with contextlib.ExitStack() as stack:
        links = []
        for number in range(CLIENTS):
            link = stack.enter_context(socket.socket())
            link.bind((f"127.0.0.{number // PER_PEER + 2}", 0))
            link.connect(("127.0.0.1", turns.line_port))
            link.setblocking(False)
            links.append(link)
        for _ in range(4):
            turns.turn()
        assert turns.lines.connections == CLIENTS
        yield links


def pour(links: list[socket.socket], lines: bytes) -> None:
    for link in links:
        with contextlib.suppress(BlockingIOError):
            link.send(lines)


def test_a_flood_of_polls_from_a_hundred_is_answered_a_few_in_a_turn(turns, flood):
    pour(flood, POLLS)
    for _ in range(CLIENTS + 2):  # the first line of each starts a request
        turns.turn()
    answered = [turns.answered() for _ in range(300)]
    assert max(answered) <= LINES.per_turn
    assert sum(answered) > 290 * LINES.per_turn


def test_of_a_flood_of_asks_from_a_hundred_one_is_started_in_a_turn(turns, flood):
    pour(flood, ASKS)
    started = [turns.started() for _ in range(300)]
    assert max(started) == 1
    assert sum(started) > 290
    assert turns.lines.counters["requests"] == sum(started)


def test_polls_before_an_ask_are_answered_in_its_turn_and_none_after_it(turns, link):
    link.send(b"EC,1,1\n")
    turns.turn()
    turns.turn()
    link.send(b"EC,1,1\n" * 3 + b"EC,1,2\n" * 2)
    assert turns.answered() == 0
    assert [turns.answered(), turns.answered()] == [4, 1]


@pytest.mark.parametrize("lines", [POLLS, ASKS], ids=["polls", "asks"])
def test_no_client_of_a_flood_waits_for_another_that_sends_more(turns, flood, lines):
    pour(flood[1:], lines)
    for _ in range(20):
        turns.turn()
    flood[0].send(b"EC,2,9\n")
    for _ in range(CLIENTS + 3):
        turns.turn()
    assert flood[0].recv(100).startswith(b"9,")


@pytest.mark.parametrize("lines", [POLLS, ASKS], ids=["polls", "asks"])
def test_the_registers_are_read_within_two_turns_beside_the_flood(turns, flood, lines):
    with RawModbus("127.0.0.1", turns.port) as robot:
        for _ in range(3):
            turns.turn()
        for number in range(200):
            pour(flood, lines)
            robot.send(b"\x03\x00\x64\x00\x44")
            turns.turn()
            turns.turn()
            robot.socket.settimeout(0.0)
            assert len(robot.receive()[2]) == 2 + 2 * 68, number
            robot.socket.settimeout(5.0)


@pytest.fixture
def link(turns):
    with socket.create_connection(("127.0.0.1", turns.line_port)) as made:
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # each piece arrives as sent
        turns.turn()
        turns.turn()
        yield made


def test_half_a_line_has_its_second_however_long_the_pause_before_it(turns, link):
    assert turns.sweep_after(0.9 * LIMITS.idle_s) == 1
    link.send(b"EC,1")
    assert turns.sweep_after(0.9 * LIMITS.partial_s) == 1
    assert turns.sweep_after(0.2 * LIMITS.partial_s) == 0
    assert turns.lines.counters["timeouts"] == 1


def test_a_slow_sender_does_not_win_time_by_one_more_byte(turns, link):
    for byte in b"EC,":
        link.send(bytes((byte,)))
        turns.sweep_after(0.4 * LIMITS.partial_s)
    assert turns.lines.connections == 0


def test_a_connection_that_asks_nothing_ends_after_its_time(turns, link):
    link.send(b"EC,1,7\n")
    for _ in range(3):
        turns.turn()
    assert turns.sweep_after(0.9 * LIMITS.idle_s) == 1
    assert turns.sweep_after(0.2 * LIMITS.idle_s) == 0


SILENT = (b"\n", b" ", b"\t", b"\r\n", b"\n \r\n")  # blanks, which get no answer
SAYING = (b"EC,1,7\n", b"(EC,2,8)\r\n", b"EC,1\r", b'<Ask Point="1" Trig="7"/>', b"GO\n")


@pytest.mark.parametrize("blank", SILENT)
def test_a_line_is_answered_after_a_buffer_full_of_blanks(turns, link, blank):
    link.send((blank * LINES.buffer_bytes)[: LINES.buffer_bytes])
    for _ in range(4):
        turns.turn()
    link.send(b"EC,1,9\n")
    for _ in range(4):
        turns.turn()
    link.settimeout(0.0)
    assert link.recv(100).startswith(b"9,")


def test_an_end_after_other_blanks_is_no_second_half_of_the_end_before(turns, link):
    for piece in (b"EC,1,7\r", b" ", b"\n", b"EC,1,8\n"):
        link.send(piece)
        for _ in range(3):
            turns.turn()
    link.settimeout(0.0)
    first, second = link.recv(1000).split(b"\r")
    assert first.startswith(b"7,")
    assert second.startswith(b"8,")


@pytest.mark.parametrize("seed", range(20))
def test_every_line_is_answered_between_whatever_gets_no_answer_and_however_it_comes(
    turns, link, seed
):
    numbers = random.Random(seed)
    sayings = numbers.choices(SAYING, k=20)
    blanks = [
        numbers.choice(SILENT) * numbers.choice((1, 256, 511, 512, 513, 1500)) for _ in sayings
    ]
    stream = b"".join(blank + saying for blank, saying in zip(blanks, sayings, strict=True))
    while stream:
        size = numbers.randrange(1, 700)
        link.sendall(stream[:size])
        stream = stream[size:]
        for _ in range(numbers.randrange(8)):
            turns.turn()
    for _ in range(500):
        turns.turn()
    assert turns.lines.counters["requests"] == len(sayings)
    assert turns.lines.counters["garbage"] == 0
