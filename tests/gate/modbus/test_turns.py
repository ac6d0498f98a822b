"""Modbus in a loop that is turned by hand: what a peer that sends without end leaves of a turn to the others."""

import contextlib
import struct
from dataclasses import replace

import pytest

from fakes.controllers.raw_modbus import RawModbus
from tests.gate.modbus.server import LIMITS, TurnedServers
from tests.gate.register_bank.bench import Bench
from vgrd.gate.pdu import MODBUS
from vgrd.gate.server import Server

ATTACKERS = 7  # one less than a peer may have
FRAMES = 300
READ = struct.pack(">BHH", 3, 100, 68)
WRITES = {  # each starts something, or drops it
    "one register": [struct.pack(">BHH", 6, 0, trig % 60000 + 1) for trig in range(FRAMES)],
    "registers": [struct.pack(">BHHBHH", 16, 0, 2, 4, t % 60000 + 1, 2) for t in range(FRAMES)],
    "write and read": [
        struct.pack(">BHHHHBH", 23, 100, 2, 0, 1, 2, t % 60000 + 1) for t in range(FRAMES)
    ],
    "mask": [struct.pack(">BHHH", 22, 0, 0, t % 60000 + 1) for t in range(FRAMES)],
    "coil": [struct.pack(">BHH", 5, 0, 0 if t % 2 else 0xFF00) for t in range(FRAMES)],
    "coils": [struct.pack(">BHHBB", 15, 0, 2, 1, 0 if t % 2 else 2) for t in range(FRAMES)],
}


def framed(pdus: list[bytes]) -> bytes:
    """One after the other, numbered from 0."""
    return b"".join(struct.pack(">HHHB", i, 0, len(p) + 1, 1) + p for i, p in enumerate(pdus))


class Turns(TurnedServers):
    """Registers of a cell that lives, and how often something was written or read."""

    def __init__(self, runtime_dir):
        bench = Bench(runtime_dir)
        bench.start_cell()
        bench.publish()
        self.bank = bench.bank
        limits = replace(LIMITS, connections_per_peer=ATTACKERS + 1)
        self.server = Server(MODBUS, bench.bank, bench.clock, limits)
        super().__init__(self.server)
        self.port = self.ports[0]

    def answered(self) -> int:
        """Turn once; how many frames that answered."""
        return self.rise(self.server.counters, "requests")


@pytest.fixture
def turns(tmp_path):
    made = Turns(tmp_path)
    yield made
    made.close()


@pytest.fixture
def attackers(turns):
    with contextlib.ExitStack() as stack:
        links = [stack.enter_context(RawModbus("127.0.0.1", turns.port)) for _ in range(ATTACKERS)]
        for _ in range(3):
            turns.turn()
        assert turns.server.connections == ATTACKERS
        yield links


@pytest.fixture
def robot(turns):
    with RawModbus("127.0.0.1", turns.port) as made:
        for _ in range(3):
            turns.turn()
        yield made


def received(link: RawModbus) -> list[tuple[int, bytes]]:
    """Numbers and PDUs of all answers that have come."""
    link.socket.settimeout(0.0)
    data, answers = b"", []
    with contextlib.suppress(BlockingIOError):
        while more := link.socket.recv(65536):
            data += more
    while data:
        number, _, length, _ = struct.unpack_from(">HHHB", data)
        answers.append((number, data[7 : 6 + length]))
        data = data[6 + length :]
    return answers


@pytest.mark.parametrize("writes", WRITES.values(), ids=WRITES)
def test_one_write_of_a_flood_is_done_in_a_turn_and_a_read_beside_it_at_once(
    turns, attackers, robot, writes
):
    for link in attackers:
        link.socket.sendall(framed(writes))
    for number in range(100):
        robot.send(READ)
        assert turns.answered() <= 2, number
        assert len(received(robot)) == 1, number


def test_every_write_of_a_flood_is_answered_in_its_order_and_no_peer_waits_for_another(
    turns, attackers
):
    for link in attackers:
        link.socket.sendall(framed(WRITES["one register"]))
    for _ in range(20 * ATTACKERS + 2):
        turns.turn()
    halfway = [received(link) for link in attackers]
    assert {len(answers) for answers in halfway} <= {19, 20, 21}
    for _ in range(FRAMES * ATTACKERS):
        turns.turn()
    for link, before in zip(attackers, halfway, strict=True):
        answers = [*before, *received(link)]
        assert answers == list(enumerate(WRITES["one register"]))


def test_of_a_flood_of_reads_a_few_are_answered_in_a_turn(turns, attackers, robot):
    for link in attackers:
        link.socket.sendall(framed([READ] * FRAMES))
    turns.turn()
    for number in range(50):
        robot.send(READ)
        assert turns.answered() <= MODBUS.per_turn + 1, number
        assert len(received(robot)) == 1, number


def test_reads_of_all_who_ask_once_are_answered_in_the_turn_that_brings_them(turns, attackers):
    for link in attackers:
        link.send(READ)
    assert turns.answered() == ATTACKERS


def test_a_read_after_a_write_of_its_connection_waits_for_it(turns, robot):
    write, see = struct.pack(">BHH", 6, 2, 9), struct.pack(">BHH", 3, 2, 1)
    robot.socket.sendall(framed([write, see]))
    robot.send(see)
    for _ in range(4):
        turns.turn()
    assert [pdu for _, pdu in received(robot)] == [write, *[b"\x03\x02\x00\x09"] * 2]


def test_a_buffer_full_of_frames_is_emptied_and_filled_again(turns, robot):
    more = 3 * MODBUS.buffer_bytes // len(framed([READ]))
    robot.socket.sendall(framed([READ] * more))
    for _ in range(more + 3):
        turns.turn()
    assert [number for number, _ in received(robot)] == list(range(more))
