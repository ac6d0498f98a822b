"""`make cell`: the fake cell stays up, calibrated, and goes without a trace."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

from fakes.cell import free_port
from fakes.memory import descendants
from vgrd.model import Calibration
from vgrd.registers import RESPONSE, Command, Status
from vgrd.store.calibrations import CalibrationStore

pytestmark = pytest.mark.system
READY_S, ANSWER_S = 60.0, 10.0


def answer(port: int) -> Status:
    """Ask for target 1 as a robot program under development would."""
    with ModbusTcpClient("127.0.0.1", port=port) as client:
        client.write_registers(0, [7, Command.EC_FRESH, 1], device_id=1)
        end_s = time.monotonic() + ANSWER_S
        while time.monotonic() < end_s:
            registers = client.read_holding_registers(
                RESPONSE.start, count=5, device_id=1
            ).registers
            if registers[3] == 7:
                return Status(registers[4])
            time.sleep(0.02)
    raise TimeoutError("no answer")


def test_a_cell_of_an_earlier_run_serves_at_once_and_ends_with_ctrl_c(
    tmp_path: Path, calibration: Calibration
) -> None:
    store = CalibrationStore(tmp_path / "state")
    store.activate(store.save(calibration), by="test")
    port = free_port()
    command = ["cell", "--folder", str(tmp_path), "--port", str(port)]
    process = subprocess.Popen(
        [sys.executable, "-m", "fakes", *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        end_s = time.monotonic() + READY_S
        while not (line := process.stdout.readline()).startswith("type: "):
            assert line, "the fake cell ended early"
            assert time.monotonic() < end_s
        assert answer(port) is Status.OK
        family = set(descendants(process.pid))
        assert len(family) > 4
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(10.0) == 0
        time.sleep(0.5)
        assert not [pid for pid in family if Path(f"/proc/{pid}").exists()]
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
