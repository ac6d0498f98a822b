"""What a robot may read and write: blocks, coils, inputs, units, and the orientation it asks for."""

import struct

import pytest

from tests.gate.register_bank.bench import Bench
from vgrd.registers import Command, Scale16, State, Status


def test_a_rising_edge_of_the_coil_is_the_next_trig(bench):
    bench.bank.write_registers(0, struct.pack(">3H", 0, Command.EC_NEWEST, 9))
    bench.bank.write_coils(0, [True])
    assert (bench.forwarded[-1].trig, bench.forwarded[-1].point) == (1, 9)
    bench.bank.write_coils(0, [True])
    assert len(bench.forwarded) == 1
    bench.bank.write_coils(0, [False])
    bench.bank.write_coils(0, [True])
    assert bench.forwarded[-1].trig == 2
    assert bench.bank.read_coils(0, 2) == [True, False]


@pytest.mark.parametrize("scale", Scale16)
def test_the_int16_units_of_the_cell_file_hold_in_every_answer(tmp_path, scale):
    bench = Bench(tmp_path, scale=scale)
    assert int(bench.see()["FMT"]) >> 8 == scale
    bench.clock.now_s += 0.1
    bench.start_cell()
    bench.publish()
    bench.trigger(1)
    assert int(bench.see()["FMT"]) >> 8 == scale
    bench.publish(bench.answer(1, seq=1, position_um=(10_000, 0, 0)))
    assert int(bench.see()["FMT"]) >> 8 == scale
    assert bench.see()["EC16_X"] == (200 if scale is Scale16.FINE else 100)


ORIENTATION = struct.pack(">3i", 3_000_000, 0, 100_000)
POLICY_3 = 3 << 8


def test_the_orientation_counts_only_if_all_of_it_was_written_since_the_last_trig(bench):
    def oriented(trig: int) -> bool:
        bench.bank.write_registers(0, struct.pack(">4H", trig, Command.EC_FRESH, 4, POLICY_3))
        return bench.forwarded[-1].orientation_written

    assert not oriented(1)
    bench.bank.write_registers(23, ORIENTATION)
    assert oriented(2)
    assert not oriented(3)
    bench.bank.write_registers(23, ORIENTATION[:10])
    assert not oriented(4)
    bench.bank.write_registers(28, ORIENTATION[10:])
    assert not oriented(5)
    for register in range(23, 29):
        bench.bank.write_registers(register, ORIENTATION[2 * register - 46 : 2 * register - 44])
    assert oriented(6)
    bench.bank.write_registers(23, ORIENTATION)
    bench.trigger(0)
    assert not oriented(7)
    bench.bank.write_registers(23, ORIENTATION)
    bench.bank.write_coils(1, [True])
    assert not oriented(8)
    whole = struct.pack(">4H", 9, Command.EC_FRESH, 4, POLICY_3) + bytes(38) + ORIENTATION
    bench.bank.write_registers(0, whole)
    assert bench.forwarded[-1].trig == 9
    assert bench.forwarded[-1].orientation_written


def test_the_coil_with_policy_3_is_refused_by_name_and_without_it_works_on(bench):
    bench.bank.write_registers(1, struct.pack(">3H", Command.EC_FRESH, 4, POLICY_3))
    bench.bank.write_registers(23, ORIENTATION)
    bench.bank.write_coils(0, [True])
    assert bench.forwarded == []
    assert bench.status() == (1, Status.BAD_PARAMETER)
    assert bench.see()["DETAIL"] == 3
    bench.bank.write_registers(3, bytes(2))
    bench.bank.write_coils(0, [False])
    bench.bank.write_coils(0, [True])
    assert bench.status() == (0, Status.BUSY)


def test_trig_by_coil_goes_round_without_zero(bench):
    bench.trigger(0xFFFF)
    bench.bank.write_coils(0, [True])
    assert bench.forwarded[-1].trig == 1


def test_inputs_show_the_state_and_a_toggle_of_the_heartbeat(bench):
    bench.publish(state=State.READY | State.TAG_B_SEEN, beat=5)
    inputs = bench.bank.read_inputs(0, 17)
    assert [i for i, value in enumerate(inputs) if value] == [0, 10, 16]
    bench.publish(state=State.READY, beat=10)
    assert bench.bank.read_inputs(16, 1) == [False]


@pytest.mark.parametrize(
    ("address", "count", "there"),
    [
        (0, 32, True),
        (31, 2, False),
        (32, 1, False),
        (99, 2, False),
        (100, 68, True),
        (101, 68, False),
        (300, 68, True),
        (367, 1, True),
        (368, 1, False),
        (65535, 125, False),
    ],
)
def test_a_read_must_lie_inside_one_block(bench, address, count, there):
    registers = bench.bank.read_registers(address, count)
    assert (registers is not None) == there
    assert not there or len(registers) == 2 * count


def test_only_the_request_can_be_written(bench):
    assert not bench.bank.write_registers(100, b"\0\1")
    assert not bench.bank.write_registers(31, bytes(4))
    assert not bench.bank.write_coils(1, [True, True])
    assert bench.bank.write_registers(31, b"\1\2")
    assert bench.bank.read_registers(31, 1) == b"\1\2"
