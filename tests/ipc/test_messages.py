import json
import socket
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.errors import ControlError, DaemonUnreachable, IpcError
from vgrd.ipc.control import ControlClient
from vgrd.ipc.messages import HEALTH_BYTES, Health, decode_line, encode_line


@given(st.text(max_size=3000), st.integers(0, 2**40))
def test_any_health_fits_its_slot_and_comes_back(detail, progress):
    packed = Health("camera", "ok", progress, detail, pid=2**22).pack()
    assert len(packed) <= HEALTH_BYTES
    back = Health.unpack(packed)
    assert (back.process, back.state, back.progress, back.pid) == ("camera", "ok", progress, 2**22)


@pytest.mark.parametrize(
    "payload", [b"", b"{}", b"[1]", b'{"process":"x","state":"fine","progress":1}']
)
def test_what_is_not_a_health_message_is_refused(payload):
    with pytest.raises(IpcError, match="not a health message"):
        Health.unpack(payload)


def test_a_line_comes_back_and_nan_is_refused():
    message = {"op": "touch", "target": "a", "n": 1, "x": [1.5, None]}
    assert decode_line(encode_line(message)) == message
    with pytest.raises(ControlError, match="cannot be sent"):
        encode_line({"x": float("nan")})


@pytest.mark.parametrize(
    ("line", "fault"),
    [(b"{", "not JSON"), (b"[1]\n", "list"), (b"\xff", "not JSON"), (b" " * 2_000_000, "at most")],
)
def test_a_bad_line_names_its_fault(line, fault):
    with pytest.raises(ControlError, match=fault):
        decode_line(line)


def answer_once(path: Path, reply: bytes) -> threading.Thread:
    """Start a daemon of one connection that sends `reply` to whatever it is asked."""
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    server.bind(str(path))
    server.listen(1)

    def serve() -> None:
        with server, server.accept()[0] as link:
            link.recv(65536)
            link.sendall(reply)

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def test_a_call_returns_the_result(tmp_path):
    path = tmp_path / "control.sock"
    thread = answer_once(path, encode_line({"id": 1, "ok": True, "result": {"state": "ok"}}))
    assert ControlClient(path).call("status", timeout_s=5.0) == {"state": "ok"}
    thread.join()


def test_a_refusal_is_a_control_error_that_names_the_daemons_error(tmp_path):
    path = tmp_path / "control.sock"
    refusal = {"id": 1, "ok": False, "error": "NotSteady", "message": "the robot moves; stop it"}
    thread = answer_once(path, encode_line(refusal))
    with pytest.raises(ControlError, match="the robot moves; stop it") as caught:
        ControlClient(path).call("touch", timeout_s=5.0, target="a")
    assert caught.value.error == "NotSteady"
    thread.join()


@pytest.mark.parametrize(
    "reply", [b"{}\n", b"nonsense\n", json.dumps({"id": 1, "ok": True}).encode() + b"\n"]
)
def test_a_reply_that_is_none_is_a_control_error(tmp_path, reply):
    path = tmp_path / "control.sock"
    thread = answer_once(path, reply)
    with pytest.raises(ControlError):
        ControlClient(path).call("status", timeout_s=5.0)
    thread.join()


def test_no_daemon_a_silent_one_and_a_closing_one_are_unreachable(tmp_path):
    path = tmp_path / "control.sock"
    with pytest.raises(DaemonUnreachable, match="is `vgrd run` active"):
        ControlClient(path).call("status", timeout_s=0.1)
    thread = answer_once(path, b"")
    with pytest.raises(DaemonUnreachable, match="closed before the reply"):
        ControlClient(path).call("status", timeout_s=5.0)
    thread.join()
    path.unlink()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as silent:
        silent.bind(str(path))
        silent.listen(1)
        with pytest.raises(DaemonUnreachable, match="timed out"):
            ControlClient(path).call("status", timeout_s=0.05)
