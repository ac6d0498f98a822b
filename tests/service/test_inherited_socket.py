"""The gate serves at a socket that a socket unit opened, and only where the cell file agrees."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.controllers.raw_modbus import RawModbus
from fakes.testing import free_port
from vgrd.orphans import dying_with_us

pytestmark = pytest.mark.system

COMES_WITHIN_S = 100.0  # a second, on a machine that is not busy

# What systemd does between fork and exec; the process id stays.
HAND_OVER = """
import os, sys
fds = [int(fd) for fd in sys.argv[1].split(",")]
for place, fd in enumerate(fds, 3):
    os.dup2(fd, place)
    os.set_inheritable(place, True)
os.environ |= {"LISTEN_PID": str(os.getpid() + int(sys.argv[3])), "LISTEN_FDS": str(len(fds)),
               "LISTEN_FDNAMES": "vgrd.socket"}
os.execv(sys.executable, [sys.executable, "-m", "vgrd.gate", sys.argv[2]])
"""
TELL = """
import contextlib, json, os, pathlib, sys, time
links = []
for fd in os.listdir("/proc/self/fd"):
    with contextlib.suppress(FileNotFoundError):  # the one that lists is gone
        links.append(os.readlink(f"/proc/self/fd/{fd}"))
seen = {"listen": [name for name in os.environ if name.startswith("LISTEN")],
        "sockets": [link for link in links if link.startswith("socket:")]}
draft = pathlib.Path(sys.argv[1] + ".draft")
draft.write_text(json.dumps(seen))
draft.rename(sys.argv[1])
time.sleep(60)
"""


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    """A socket as a socket unit opens it."""
    with socket.create_server(("127.0.0.1", 0)) as opened:
        yield opened


class Handed:
    """A gate with sockets handed over, its cell file saying `port`; killed at the end."""

    def __init__(
        self, folder: Path, port: int, sockets: list[socket.socket], pid_off_by: int = 0
    ) -> None:
        self.seen = folder / "seen.json"
        child = {"name": "child", "argv": [sys.executable, "-c", TELL, str(self.seen)]}
        modbus = {"host": "127.0.0.1", "port": port, "allow": ["127.0.0.1"]}
        table = {"cell": "test", "modbus": modbus, "processes": [child]}
        (folder / "processes.json").write_text(json.dumps(table))
        fds = ",".join(str(opened.fileno()) for opened in sockets)
        self.process = subprocess.Popen(
            dying_with_us([sys.executable, "-c", HAND_OVER, fds, str(folder), str(pid_off_by)]),
            pass_fds=[opened.fileno() for opened in sockets],
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "Handed":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def wait_for_child(self) -> dict[str, list[str]]:
        end = time.monotonic() + COMES_WITHIN_S
        while not self.seen.exists():
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < end
            time.sleep(0.01)
        return json.loads(self.seen.read_text())

    def refusal(self) -> str:
        """Its last words; it must end by itself."""
        said = self.process.communicate(timeout=COMES_WITHIN_S)[1]
        assert self.process.returncode == 69
        return said


def test_registers_are_served_at_a_socket_that_was_handed_over(tmp_path, listening) -> None:
    port = listening.getsockname()[1]
    with Handed(tmp_path, port, [listening]) as gate:
        gate.wait_for_child()
        with RawModbus("127.0.0.1", port) as client:
            assert len(client.read(100, 68)) == 136


def test_a_robot_that_connects_before_the_daemon_runs_is_served_by_it(tmp_path, listening) -> None:
    port = listening.getsockname()[1]
    with RawModbus("127.0.0.1", port) as early, Handed(tmp_path, port, [listening]) as gate:
        gate.wait_for_child()
        assert len(early.read(100, 68)) == 136


def test_children_learn_nothing_of_the_socket(tmp_path, listening) -> None:
    with Handed(tmp_path, listening.getsockname()[1], [listening]) as gate:
        assert gate.wait_for_child() == {"listen": [], "sockets": []}


def test_a_socket_at_another_address_than_the_cell_files_is_refused(tmp_path, listening) -> None:
    other = free_port()
    with Handed(tmp_path, other, [listening]) as gate:
        said = gate.refusal()
    assert f"127.0.0.1:{listening.getsockname()[1]}" in said
    assert f"127.0.0.1:{other}" in said
    assert "ListenStream=" in said


def test_a_socket_at_every_address_is_not_the_one_of_the_cell_file(tmp_path) -> None:
    everywhere = "0.0.0.0"  # noqa: S104 (that is the fault)
    with (
        socket.create_server((everywhere, 0)) as wide,
        Handed(tmp_path, wide.getsockname()[1], [wide]) as gate,
    ):
        assert everywhere in gate.refusal()


def test_two_sockets_are_refused(tmp_path, listening) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as second,
        Handed(tmp_path, listening.getsockname()[1], [listening, second]) as gate,
    ):
        assert "2 sockets" in gate.refusal()


@pytest.mark.parametrize("kind", ["datagram", "connected"])
def test_what_is_no_listening_tcp_socket_is_refused(tmp_path, listening, kind: str) -> None:
    address = listening.getsockname()
    wrong = (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if kind == "datagram"
        else socket.create_connection(address)
    )
    with wrong, Handed(tmp_path, address[1], [wrong]) as gate:
        assert "not a listening TCP socket" in gate.refusal()


def test_a_socket_meant_for_another_process_is_left_alone(tmp_path, listening) -> None:
    port = free_port()
    with Handed(tmp_path, port, [listening], pid_off_by=1) as gate:
        assert gate.wait_for_child()["listen"] == []
        with RawModbus("127.0.0.1", port) as client:
            assert len(client.read(100, 68)) == 136
