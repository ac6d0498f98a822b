"""Every request against pymodbus's client as oracle and against raw bytes; garbage costs its connection only."""

import struct
import threading

import pytest

from tests.gate.modbus.server import is_closed, pester
from vgrd.registers import Status


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


def test_random_bytes_and_mutated_requests_leave_the_server_serving(serving):
    valid = [
        struct.pack(">HHHBBHH", 7, 0, 6, 1, 3, 100, 68),
        struct.pack(">HHHBBHHBHH", 7, 0, 11, 1, 16, 0, 2, 4, 1, 2),
        struct.pack(">HHHBBHHHHBH", 7, 0, 13, 1, 23, 100, 2, 0, 1, 2, 5),
        struct.pack(">HHHBBHHBB", 7, 0, 8, 1, 15, 0, 2, 1, 3),
    ]
    pester(lambda: serving.client(timeout_s=1.0), valid)
    with serving.client() as fresh:
        assert fresh.read(100, 1) == b"\x01\x00"
        assert len(fresh.read(100, 68)) == 136
