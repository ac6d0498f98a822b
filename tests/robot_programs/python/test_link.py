"""The Python client's connection: real sockets, the real server, and peers that misbehave."""

import contextlib
import socket
import struct
import subprocess
import sys
import threading

import pytest

from tests.gate.modbus.server import ServerThread
from tests.robot_programs import python_run
from tests.robot_programs.python_run import module_of

CLIENT = module_of(python_run.FILE.read_text())
DRY_RUN = python_run.FILE.with_name("dry_run.py")
LINK_S = 0.2
READ = struct.pack(">HHHBB", 1, 0, 3 + 2 * CLIENT.COUNT, 1, 3) + bytes((2 * CLIENT.COUNT,))


def link_to(port: int, timeout_s: float = LINK_S):
    return CLIENT.ModbusLink(CLIENT.Address("127.0.0.1", port), timeout_s)


@contextlib.contextmanager
def peer(*answers: bytes):
    """Takes one connection and answers its first request with these pieces; then closes."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            taken, _ = listener.accept()
            with taken:
                taken.recv(300)
                for answer in answers:
                    taken.sendall(answer)
                if not answers:
                    taken.recv(300)  # silent until the client goes

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()


def test_the_real_server_is_read_and_written(tmp_path):
    with ServerThread(tmp_path) as serving:
        link = link_to(serving.port, 5.0)
        link.open()
        link.write([7, 2, 1] + [0] * (CLIENT.REQUEST_WORDS - 3))
        words = link.read()
        link.close()
    assert CLIENT.value(words, "MAPVER") == CLIENT.MAP_VERSION
    assert serving.bank.counters["triggers"] == 1


def test_an_answer_may_come_in_pieces():
    whole = READ + bytes(2 * CLIENT.COUNT)
    with peer(whole[:3], whole[3:50], whole[50:]) as port:
        link = link_to(port, 5.0)
        link.open()
        assert link.read() == (0,) * CLIENT.COUNT
        link.close()


@pytest.mark.parametrize(
    "answers",
    [
        (),
        (b"",),
        (READ[:5],),
        (struct.pack(">HHHBBB", 1, 0, 3, 1, 0x83, 2),),
        (struct.pack(">HHHBBB", 9, 0, 3, 1, 3, 0),),
        (struct.pack(">HHHBBBH", 1, 0, 5, 1, 3, 2, 0),),
    ],
    ids=["silence", "closed", "cut", "exception", "another transaction", "too short"],
)
def test_what_is_no_answer_is_no_link(answers):
    with peer(*answers) as port:
        link = link_to(port)
        link.open()
        with pytest.raises(CLIENT.LinkLost):
            link.read()
        link.close()


def test_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    link = link_to(port)
    with pytest.raises(CLIENT.LinkLost):
        link.open()
    with pytest.raises(CLIENT.LinkLost, match="not connected"):
        link.read()


@pytest.mark.parametrize("words", [["--point", "70000"], ["--point", "-1"], ["--port", "99999"]])
def test_a_dry_run_tells_what_it_may_be_asked_for(words):
    ran = subprocess.run(
        [sys.executable, "-S", "-E", str(DRY_RUN), *words],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert ran.returncode == 2
    assert "1 to 65535" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_a_dry_run_needs_nothing_but_python_and_tells_why_it_stops(tmp_path):
    with ServerThread(tmp_path) as serving:  # a gate whose cell never came
        ran = subprocess.run(
            [sys.executable, "-S", "-E", str(DRY_RUN), "--port", str(serving.port)],
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
    assert ran.returncode == 1
    assert ran.stdout.splitlines()[0] == "connect"
    assert ran.stdout.splitlines()[-1].startswith(("HEARTBEAT: ", "LINK: "))  # a busy machine
    assert not ran.stderr
