"""`python -m vgrd.gate` in a folder of its own, the children that it is given, and a robot that asks it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from fakes.controllers.raw_modbus import RawModbus
from vgrd.errors import IpcError
from vgrd.ipc.messages import GATE_KIND, GATE_RING, GateReport, ProcessReport
from vgrd.ipc.ring import RingReader
from vgrd.orphans import dying_with_us
from vgrd.registers import RESPONSE, Command, Status

HERE = Path(__file__).parent
DEADLINE_S = 0.25
# What a fault may take beyond the deadline on a busy machine.
MARGIN_S = 0.35
COMES_WITHIN_S = 60.0
HANG_DEVICE = "import ctypes; ctypes.PyDLL(None).pause()"


class GateProcess:
    """`python -m vgrd.gate` on a folder of its own; killed at the end of the `with`."""

    def __init__(
        self,
        runtime_dir: Path,
        processes: list[dict],
        env: dict[str, str] | None = None,
        deadline_s: float = DEADLINE_S,
        line_port: int | None = None,
    ):
        self.runtime_dir = runtime_dir
        self.env = {**os.environ, **(env or {})}
        runtime_dir.mkdir(exist_ok=True)
        table = {
            "cell": "test",
            "deadline_s": deadline_s,
            "modbus": {
                "host": "127.0.0.1",
                "port": 0,
                "line_port": line_port,
                "allow": ["127.0.0.1"],
            },
            "processes": processes,
        }
        (runtime_dir / "processes.json").write_text(json.dumps(table))

    def __enter__(self) -> "GateProcess":
        self.log = (self.runtime_dir / "gate.log").open("a")
        self.process = subprocess.Popen(
            dying_with_us([sys.executable, "-m", "vgrd.gate", str(self.runtime_dir)]),
            stderr=self.log,
            env=self.env,
        )
        self.port = until(lambda: self.report()).port
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.log.close()

    def report(self) -> GateReport | None:
        """Return what this very gate says about itself, None before it says anything."""
        try:
            with RingReader.open(self.runtime_dir / GATE_RING, GATE_KIND) as ring:
                message = ring.newest()
        except IpcError:
            return None
        report = GateReport.unpack(message.payload) if message else None
        return report if report and report.pid == self.process.pid else None

    def row(self, name: str) -> ProcessReport:
        """Return one row of the process table."""
        report = self.report()
        assert report is not None
        return next(row for row in report.processes if row.name == name)

    def pid(self, name: str) -> int:
        """Id of a process that runs; one that waits for its start has none, and 0 would mean us all."""
        return until(lambda: self.row(name).pid)

    def client(self) -> RawModbus:
        """Connect."""
        return RawModbus("127.0.0.1", self.port)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> float:
        """Ask it to stop and return how long that took."""
        begin = time.monotonic()
        self.process.send_signal(number)
        self.process.wait(COMES_WITHIN_S)
        return time.monotonic() - begin


def until(condition, timeout_s: float = COMES_WITHIN_S):
    """First true value of `condition`."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.01)
    raise AssertionError("it did not come true in time")


def cell(runtime_dir: Path, **more) -> dict:
    argv = [sys.executable, str(HERE / "fake_cell.py"), str(runtime_dir)]
    return {"name": "cell", "argv": argv, "kind": "cell", "hang_s": 1.0, **more}


def script(name: str, code: str, **more) -> dict:
    return {"name": name, "argv": [sys.executable, "-c", code], "kind": "device", **more}


def see(client: RawModbus) -> dict[str, float]:
    return RESPONSE.decode(client.read(100, 68))


def ask(client: RawModbus, trig: int, point: int, **more) -> None:
    client.write(0, [trig, Command.EC_FRESH, point, 0, 0, 0, 0, 0, 0, more.get("timeout_ms", 0)])


def answered(client: RawModbus, trig: int) -> dict[str, float]:
    return until(lambda: (v := see(client))["ECHO"] == trig and v)


def served(client: RawModbus, trig: int, point: int) -> dict[str, float]:
    """A good answer; asked for again, with the next trigger, where a busy machine lost the cell or the time."""
    end = time.monotonic() + COMES_WITHIN_S
    while True:
        ask(client, trig, point)
        v = answered(client, trig)
        if v["STATUS"] == Status.OK or time.monotonic() > end:
            return v
        assert v["STATUS"] in (Status.INTERNAL_ERROR, Status.TIMEOUT, Status.STARTING)
        trig += 1
        time.sleep(0.1)
