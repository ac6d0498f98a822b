"""Lines over real sockets: one answer for one request, and who misbehaves loses its own connection only."""

import asyncio
import socket
import threading
import time
from contextlib import suppress

import pytest

from fakes.controllers.raw_lines import RawLines
from tests.gate.modbus.server import LIMITS, ServerThread, connect_from, pester
from vgrd.clock import SystemClock
from vgrd.errors import ServingError
from vgrd.gate.lines import LINES
from vgrd.gate.server import Server
from vgrd.registers import Status

STARTING = "99999.00,99999.00,99999.00,999.000,999.000,999.000,9999"
LINES_OF_A_FLOOD = 20_000


def is_closed(client: RawLines, within_s: float = 3.0) -> bool:
    """Whether the server closes it; whatever it still says does not count."""
    client.socket.settimeout(within_s)
    try:
        while client.socket.recv(65536):
            pass
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False
    return True


@pytest.fixture
def serving(tmp_path):
    with ServerThread(tmp_path, language=LINES) as made:
        yield made


@pytest.fixture
def client(serving):
    with RawLines("127.0.0.1", serving.port) as made:
        yield made


def test_an_answer_comes_in_the_frame_and_with_the_end_of_its_request(client):
    status = int(Status.STARTING)
    assert client.call(b"EC,1,7\n") == f"7,{status},9999,0,{STARTING}\n"
    assert client.call(b"EC,1,7\r\n") == f"7,{status},9999,0,{STARTING}\r\n"
    assert client.call(b"EC,1,7\r", b"\r") == f"7,{status},9999,0,{STARTING}\r"
    assert client.call(b"(EC,1,7)\n") == f"(7,{status},9999,0,{STARTING})\n"
    document = client.call(b'<Ask Point="1" Trig="7" Opt="0"/>', b"</Vgrd>")
    assert document.startswith(
        f'<Vgrd Echo="7" Status="{status}" Age="9999" Hb="0" U95="9999"><Ec X='
    )


def test_an_end_that_comes_in_two_pieces_goes_back_in_two(client):
    assert client.call(b"EC,1,7\r", b"\r").endswith("\r")
    assert client.call(b"\n") == "\n"
    assert client.call(b"EC,1,7\n").count("\n") == 1


def test_a_request_in_single_bytes_and_blank_lines_between_requests(client):
    for byte in b"\r\n\n  EC,1,7":
        client.socket.sendall(bytes((byte,)))
    assert client.call(b"\n\n\n").startswith("7,")
    assert client.call(b"EC,1,8\n").startswith("8,")


def test_every_line_of_a_flood_is_answered_in_its_order(serving, client):
    flood = b"".join(b"EC,1,%d\n" % (n % 65535 + 1) for n in range(LINES_OF_A_FLOOD))
    threading.Thread(target=client.socket.sendall, args=(flood,)).start()
    with client.socket.makefile("r") as answers:
        trigs = [int(answers.readline().partition(",")[0]) for _ in range(LINES_OF_A_FLOOD)]
    assert trigs == [n % 65535 + 1 for n in range(LINES_OF_A_FLOOD)]
    assert serving.server.counters["requests"] == LINES_OF_A_FLOOD


def test_what_cannot_be_read_is_answered_counted_and_costs_nothing_else(serving, client):
    assert client.call(b"GO\n") == f"0,101,9999,0,{STARTING}\n"
    assert client.call(b"EC,1\n") == f"0,103,9999,0,{STARTING}\n"
    assert client.call(b"(EC,x,9)\n") == f"(9,103,9999,0,{STARTING})\n"
    assert 'Echo="0" Status="103"' in client.call(b"<Ask/>", b"</Vgrd>")
    assert serving.server.counters["exceptions"] == 4
    assert serving.bank.counters["triggers"] == 0
    assert client.call(b"EC,1,7\n").startswith("7,901,")


@pytest.mark.parametrize(
    "garbage",
    [b"EC,1,7\0\n", b"\xff\xfe\n", b"E" * 81, b"EC,1,7" + b" " * 80 + b"\n", b"<" + b"x" * 256, b"\0" * 8],
)  # fmt: skip
def test_bytes_that_are_no_line_close_their_connection_and_no_other(serving, client, garbage):
    with RawLines("127.0.0.1", serving.port) as bad:
        bad.socket.sendall(garbage)
        assert is_closed(bad, 1.0)
    assert client.call(b"EC,1,7\n").startswith("7,")
    assert serving.server.counters["garbage"] == 1


def test_a_client_that_does_not_take_its_answers_is_closed(client):
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.socket.settimeout(60)  # the kernel takes tens of thousands of answers before it is full
    with pytest.raises(ConnectionError):
        client.socket.sendall(b"EC,1,7\n" * 10_000_000)


def test_a_slow_client_that_takes_its_answers_gets_all_of_them(client):
    count = 3000
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    threading.Thread(target=client.socket.sendall, args=(b"EC,1,7\n" * count,)).start()
    received = b""
    while received.count(b"\n") < count:
        received += client.socket.recv(4096)
        time.sleep(0.001)
    assert received == received[: len(received) // count] * count


def test_a_port_that_is_taken_is_named_with_its_own_key(serving):
    second = Server(LINES, serving.bank, SystemClock(), LIMITS)
    with pytest.raises(ServingError, match=r"lines on 127.0.0.1.*change \[serving\] line_port"):
        asyncio.run(second.listen("127.0.0.1", serving.port))


def test_a_peer_that_is_not_listed_is_refused(serving):
    with connect_from("127.9.9.9", serving.port) as stranger:
        stranger.settimeout(3)
        with suppress(ConnectionResetError):
            assert stranger.recv(1) == b""
    assert serving.server.counters["refused"] == 1


def test_random_bytes_and_mutated_lines_leave_the_server_serving(serving):
    valid = [b"EC,1,7\n", b"(EC,2,8,2,0,16)\r\n", b'<Ask Point="1" Trig="7"/>', b"EC,1,0\r"]
    pester(lambda: RawLines("127.0.0.1", serving.port), valid)
    with RawLines("127.0.0.1", serving.port) as fresh:
        assert fresh.call(b"EC,1,7\n").startswith("7,901,")
