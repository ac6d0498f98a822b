"""Requests of the line server: what is one, what is none, and that any cut of the bytes says the same."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.lines import (
    LONGEST_DOCUMENT,
    LONGEST_LINE,
    Asked,
    Frame,
    RefusedError,
    UnreadableError,
    cut,
    read,
)
from vgrd.registers import REQUEST, Status

FRESH = {"POINT": 1, "CMD": 2, "OBJECT": 0, "OPT": 0, "MAXAGE": 0, "MAXU95": 0}
numbers = st.integers(0, 65535)


def asked(request: bytes) -> Asked:
    piece = cut(request)
    assert piece is not None
    return read(piece)


@pytest.mark.parametrize(
    ("request_bytes", "frame", "more"),
    [
        (b"EC,1,7\n", Frame.BARE, {}),
        (b"EC,1,7\r\n", Frame.BARE, {}),
        (b"EC,1,7\r", Frame.BARE, {}),
        (b"EC , 1,\t7 \n", Frame.BARE, {}),
        (b"EC,001,00007,,,,,\n", Frame.BARE, {}),
        (b"EC,1,7,1,2,16,300,400\n", Frame.BARE,
         {"CMD": 1, "OBJECT": 2, "OPT": 16, "MAXAGE": 300, "MAXU95": 400}),
        (b"(EC,1,7,,,3)\n", Frame.BRACKETS, {"OPT": 3}),
        (b"( EC,1,7 )\r\n", Frame.BRACKETS, {}),
        (b'<Ask Point="1" Trig="7"/>', Frame.XML, {"OPT": 32}),
        (b'<Ask\n  Trig="7"\tPOINT = " 1 " />', Frame.XML, {"OPT": 32}),
        (b'<Ask Point="1" Trig="7" Opt="0" MaxAge="5"> </Ask>', Frame.XML, {"MAXAGE": 5}),
    ],
)  # fmt: skip
def test_what_is_asked(request_bytes, frame, more):
    piece = cut(request_bytes)
    assert piece is not None
    assert piece.frame is frame
    assert piece.length == len(request_bytes)
    assert read(piece) == Asked(7, FRESH | more)


@pytest.mark.parametrize(
    ("line", "status", "trig"),
    [
        (b"HELLO\n", Status.UNKNOWN_COMMAND, 0),
        (b"GET / HTTP/1.1\r\n", Status.UNKNOWN_COMMAND, 0),
        (b"ec,1,7\n", Status.UNKNOWN_COMMAND, 0),
        (b"(EC,1,7\n", Status.UNKNOWN_COMMAND, 0),
        (b"EC\n", Status.BAD_PARAMETER, 0),
        (b"EC,1\n", Status.BAD_PARAMETER, 0),
        (b"EC,1,7)\n", Status.BAD_PARAMETER, 0),
        (b"EC,1,65536\n", Status.BAD_PARAMETER, 0),
        (b"EC,1,-7\n", Status.BAD_PARAMETER, 0),
        (b"EC,1,7.0\n", Status.BAD_PARAMETER, 0),
        (b"EC,,7\n", Status.BAD_PARAMETER, 7),
        (b"EC,65536,7\n", Status.BAD_PARAMETER, 7),
        (b"EC,1,7,x\n", Status.BAD_PARAMETER, 7),
        (b"EC,1,7,1e1\n", Status.BAD_PARAMETER, 7),
        (b"EC,1,7,,,,,0,\n", Status.BAD_PARAMETER, 0),
        (b"<Ask/>", Status.BAD_PARAMETER, 0),
        (b'<Ask Trig="7"/>', Status.BAD_PARAMETER, 7),
        (b'<Ask Point="1" Trig="7" Trig="8"/>', Status.BAD_PARAMETER, 0),
        (b'<Ask Point="1" Trig="7" Speed="8"/>', Status.BAD_PARAMETER, 0),
        (b'<Tell Point="1" Trig="7"/>', Status.BAD_PARAMETER, 0),
        (b"<Ask><Point>1</Point></Ask>", Status.BAD_PARAMETER, 0),
    ],
)
def test_a_whole_request_that_says_nothing_usable_is_refused_as_whole(line, status, trig):
    piece = cut(line)
    assert piece is not None
    assert piece.length == len(line)
    with pytest.raises(RefusedError) as refused:
        read(piece)
    assert (refused.value.status, refused.value.trig) == (status, trig)


@pytest.mark.parametrize(
    "received",
    [
        b"EC,1,7\0\n",
        b"\x80",
        b"EC,1,\xb2\n",
        b"\x1bEC,1,7\n",
        b"E" * LONGEST_LINE,
        b"E" * (LONGEST_LINE + 1) + b"\n",
        b"<" + b"a" * LONGEST_DOCUMENT,
        b"<Ask>" + b" " * LONGEST_DOCUMENT,
        b"<?xml version='1.0'?><Ask/>",
        b"</Ask>",
    ],
)
def test_what_is_no_line_is_unreadable(received):
    with pytest.raises(UnreadableError):
        cut(received)


def test_the_longest_line_is_one_and_one_more_character_is_not():
    line = b"EC,1,7" + b" " * (LONGEST_LINE - len(b"EC,1,7\n")) + b"\n"
    assert len(line) == LONGEST_LINE
    assert asked(line).trig == 7
    with pytest.raises(UnreadableError):
        cut(b" " + line)


@given(st.binary(max_size=300))
def test_any_bytes_are_cut_refused_or_unreadable_and_a_start_of_them_says_nothing_else(received):
    """Half a line says nothing, or is unreadable; it is never another request."""
    try:
        piece = cut(received)
    except UnreadableError:
        return
    if piece is None:
        return
    assert 0 < piece.length <= len(received)
    for length in range(1, piece.length):
        try:
            start = cut(received[:length])
        except UnreadableError:
            pytest.fail("the start of a whole request was unreadable")
        assert start is None or (start.text == piece.text and start.end == "\r")


@given(numbers, numbers, st.lists(numbers, max_size=5), st.sampled_from(("\n", "\r", "\r\n")))
def test_all_numbers_come_back_in_the_registers(point, trig, more, end):
    words = ",".join(map(str, ("EC", point, trig, *more)))
    read_back = asked(f"{words}{end}".encode())
    values = REQUEST.decode(read_back.registers())
    names = ("CMD", "OBJECT", "OPT", "MAXAGE", "MAXU95")
    assert (read_back.trig, values["TRIG"], values["POINT"]) == (trig, 0, point)
    assert [values[name] for name in names[: len(more)]] == more
    assert asked(f"({words}){end}".encode()) == read_back


def test_the_longest_document_of_all_attributes_is_far_from_too_long():
    names = ("Point", "Trig", "Cmd", "Object", "Opt", "MaxAge", "MaxU95")
    document = "<Ask" + "".join(f' {name}="65535"' for name in names) + "></Ask>"
    assert 2 * len(document) <= LONGEST_DOCUMENT
    assert asked(document.encode()).trig == 65535
