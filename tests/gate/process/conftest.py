"""A gate whose cell is ready."""

import pytest

from tests.gate.process.gate_process import GateProcess, cell, see, until
from vgrd.registers import State


@pytest.fixture
def gate(tmp_path):
    with GateProcess(tmp_path, [cell(tmp_path)]) as running:
        with running.client() as client:
            until(lambda: see(client)["STATE"] == State.READY)
        yield running
