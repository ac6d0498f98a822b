"""Lines in a loop that is turned by hand: what they do in one turn, and what time alone does to a connection."""

import contextlib
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
FLOOD = b"EC,1,7\n" * 5000


class Turns(TurnedServers):
    """Registers and lines in one loop, on a clock that tests set."""

    def __init__(self, runtime_dir):
        bench = Bench(runtime_dir)
        bench.start_cell()
        bench.publish()
        self.clock = bench.clock
        limits = replace(LIMITS, allow=("127.0.0.0/8",), connections=CLIENTS)
        registers = Server(MODBUS, bench.bank, bench.clock, limits)
        self.lines = Server(LINES, bench.bank, bench.clock, limits)
        super().__init__(registers, self.lines)
        self.port, self.line_port = self.ports

    def answered(self) -> int:
        """Turn once; how many lines that answered."""
        before = self.lines.counters["requests"]
        self.turn()
        return self.lines.counters["requests"] - before

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


def pour(links: list[socket.socket]) -> None:
    for link in links:
        with contextlib.suppress(BlockingIOError):
            link.send(FLOOD)


def test_a_flood_of_lines_from_a_hundred_is_answered_a_few_in_a_turn(turns, flood):
    pour(flood)
    answered = [turns.answered() for _ in range(300)]
    assert max(answered) <= LINES.per_turn
    assert sum(answered) > 290 * LINES.per_turn


def test_no_client_of_a_flood_waits_for_another_that_sends_more(turns, flood):
    pour(flood[1:])
    for _ in range(20):
        turns.turn()
    flood[0].send(b"EC,2,9\n")
    fair = CLIENTS // LINES.per_turn + 3
    for _ in range(fair):
        turns.turn()
    assert flood[0].recv(100).startswith(b"9,")


def test_the_registers_are_read_within_two_turns_beside_the_flood(turns, flood):
    with RawModbus("127.0.0.1", turns.port) as robot:
        for _ in range(3):
            turns.turn()
        for number in range(200):
            pour(flood)
            robot.send(b"\x03\x00\x64\x00\x44")
            turns.turn()
            turns.turn()
            robot.socket.settimeout(0.0)
            assert len(robot.receive()[2]) == 2 + 2 * 68, number
            robot.socket.settimeout(5.0)


@pytest.fixture
def link(turns):
    with socket.create_connection(("127.0.0.1", turns.line_port)) as made:
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
