"""What a request says, in its registers and over the link to the cell."""

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.errors import IpcError
from vgrd.registers import REQUEST, PolicyCode, Request, parse_message, request_message

u16 = st.integers(0, 0xFFFF)


@given(st.lists(u16, min_size=32, max_size=32))
def test_a_request_reads_what_was_written(words):
    registers = struct.pack(">32H", *words)
    request = Request.parse(registers)
    fields = REQUEST.decode(registers)
    assert (request.trig, request.command, request.point) == tuple(words[:3])
    assert request.max_age_s == words[7] / 1000
    assert request.refuse_if_moving == bool(words[3] & 1)
    assert request.policy == PolicyCode((words[3] >> 8) & 3)
    assert fields["CLHB"] == words[22]


@pytest.mark.parametrize(
    ("options", "written", "value"),
    [(0, 1_000_000, 1.0), (1 << 4, 1_800_000, 180.0), (3 << 4, -900_000, -90.0)],
)
def test_the_requested_orientation_is_scaled_by_its_format(options, written, value):
    fields = {field.name: 0 for field in REQUEST.fields} | {"OPT": options, "ORI_RX": written}
    request = Request.parse(REQUEST.encode(fields))
    assert request.request_orientation[0] == pytest.approx(value)


@given(st.binary(min_size=64, max_size=64), st.integers(0, 2**64 - 1), st.booleans())
def test_a_request_goes_over_the_link_with_its_nonce(registers, nonce, written):
    request = Request.parse(registers, nonce, orientation_written=written)
    assert parse_message(json.loads(json.dumps(request_message(request)))) == request


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"nonce": 1, "orientation_written": True, "registers": "zz"},
        {"nonce": 1, "orientation_written": True, "registers": "00"},
        {"nonce": "1", "orientation_written": True, "registers": "00" * 64},
        {"nonce": 1, "orientation_written": 1, "registers": "00" * 64},
        {"nonce": 1, "registers": "00" * 64},
    ],
)
def test_what_is_no_request_of_the_gate_is_refused(message):
    with pytest.raises(IpcError, match="not a request"):
        parse_message(message)


def test_an_unknown_rotation_format_is_none():
    assert Request.parse(struct.pack(">4H", 1, 1, 1, 7 << 4) + bytes(56)).rotation_format is None
