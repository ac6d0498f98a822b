"""A cell process that answers at once with a made-up coordinate; the POINT asked for makes it fail.

`python fake_cell.py RUNTIME_DIR`. Not a test: gate_process.py has it started by the gate.
"""

import ctypes
import math
import os
import signal
import socket
import sys
import time
from dataclasses import replace
from pathlib import Path

import structlog

from vgrd import logs
from vgrd.clock import SystemClock
from vgrd.ipc.health import HealthReporter
from vgrd.ipc.messages import decode_line, encode_line
from vgrd.ipc.ring import RingWriter
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REGISTER_RING,
    Answer,
    RegisterImage,
    Request,
    State,
    Status,
    parse_message,
    reply,
)

HANG_WITH_GIL, ABORT, EXIT, STOP, SILENT, CONFIG, IGNORE_TERM = range(66, 73)
PERIOD_S = 0.02
VALID_S = 60.0


def fail(point: int) -> None:
    """Do to this process what `point` says."""
    if point == HANG_WITH_GIL:
        ctypes.PyDLL(None).pause()
    if point == ABORT:
        os.abort()
    if point == EXIT:
        os._exit(3)
    if point == STOP:
        os.kill(os.getpid(), signal.SIGSTOP)
    if point == CONFIG:
        os._exit(78)
    if point == IGNORE_TERM:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def answer_to(request: Request, seq: int) -> Answer:
    """A coordinate that holds the point's number."""
    now = time.monotonic()
    return replace(
        reply(request, Status.OK),
        seq=seq,
        captured_s=now,
        valid_until_s=now + VALID_S,
        position_um=(1000 * request.point, 0, 0),
        rotation=(0.0, 0.0, math.pi / 2),
        u95_um=100,
    )


def main() -> None:
    """Publish until killed."""
    runtime_dir = Path(sys.argv[1])
    logs.configure("cell")
    log, libc = structlog.get_logger(), ctypes.CDLL(None)
    health = HealthReporter(runtime_dir, "cell", SystemClock())
    ring = RingWriter.create(runtime_dir / REGISTER_RING, 4, PACKED_BYTES, REGISTER_KIND)
    link = socket.socket(fileno=int(os.environ["VGRD_GATE_FD"]))
    link.settimeout(PERIOD_S)
    link.sendall(encode_line({"op": "ready"}))
    answer, beat, unread = Answer(), 0, b""
    while True:
        beat += 1
        health.progress("ok")
        now = time.monotonic()
        ring.publish(RegisterImage(answer, State.READY, beat, now).pack(), stamp_s=now)
        try:
            received = link.recv(65536)
        except TimeoutError:
            continue
        if not received:
            return
        *lines, unread = (unread + received).split(b"\n")
        for line in lines:
            log.warning("asked", padding=200 * "x")
            libc.perror(b"what a library writes by itself")
            message = decode_line(line)
            if message["op"] == "abort":
                continue
            request = parse_message(message)
            fail(request.point)
            if request.point != SILENT:
                answer = answer_to(request, answer.seq + 1)


if __name__ == "__main__":
    main()
