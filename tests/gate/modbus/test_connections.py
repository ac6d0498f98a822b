"""Which connections are let in, which are kept and which are closed for others or for their silence."""

import contextlib
import socket
import struct
import time
from dataclasses import replace

import pytest

from tests.gate.modbus.server import LIMITS, ServerThread, connect_from, is_closed


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


def test_a_robot_that_comes_back_takes_the_place_of_its_silent_connections(serving):
    with contextlib.ExitStack() as stack:
        for _ in range(LIMITS.connections_per_peer):
            stack.enter_context(serving.client())
        time.sleep(LIMITS.silent_s + 0.05)
        back = stack.enter_context(serving.client())
        assert back.read(100, 1) == b"\x01\x00"
        assert serving.server.counters["evicted"] == 1
