"""What a command says of a daemon that runs and does not answer."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.world import CellNoise, World
from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved, save_resolved
from vgrd.config.setup import process_table
from vgrd.gate.settings import save_table
from vgrd.ipc.messages import (
    GATE_BYTES,
    GATE_KIND,
    GATE_RING,
    GATE_SLOTS,
    GateReport,
    ProcessReport,
)
from vgrd.ipc.ring import RingWriter

PID = 4242


class Gate:
    """The traces that a gate leaves in the runtime folder of tmp_path's cell."""

    def __init__(self, folder: Path) -> None:
        facts_of(World(Layout(), 5, CellNoise.none()), folder)
        config = load_config(folder / "cell.toml")
        self.runtime = Path(config.cell.runtime_dir)
        self.runtime.mkdir()
        resolved = Resolved(config, str(folder / "cell.toml"), time.time() - 12.0)
        save_table(self.runtime, process_table(resolved, save_resolved(resolved, self.runtime)))
        self.ring = RingWriter.create(self.runtime / GATE_RING, GATE_SLOTS, GATE_BYTES, GATE_KIND)

    def report(self, cell: ProcessReport, age_s: float = 0.0) -> None:
        report = GateReport(PID, "127.0.0.1", 1502, {}, (cell,))
        self.ring.publish(report.pack(), stamp_s=time.monotonic() - age_s)


@pytest.fixture
def gate(tmp_path: Path) -> Iterator[Gate]:
    gate = Gate(tmp_path)
    yield gate
    gate.ring.close()


STARTING = ProcessReport("cell", "cell", 4243, "running", 1, 0, None, "starting", "")


@pytest.mark.parametrize("words", [("status",), ("look",), ("ec", "P1")])
def test_a_daemon_that_starts_says_since_when_and_asks_to_be_asked_again(
    vgrd, gate, tmp_path, words
):
    gate.report(STARTING)
    done = vgrd(*words, "--config", tmp_path / "cell.toml")
    assert done.code == 75
    assert f"the daemon (process {PID}) is starting since 1" in done.err  # 12 s, or some more
    assert "vgrd run" not in done.err


def test_a_cell_that_ends_again_and_again_is_told_with_its_reason(vgrd, gate, tmp_path):
    gate.report(ProcessReport("cell", "cell", 0, "waiting", 5, 0, 78, "failed", "no such key"))
    done = vgrd("status", "--config", tmp_path / "cell.toml")
    assert done.code == 75
    assert "its cell does not answer: waiting, started 5 times, failed no such key" in done.err


def test_the_traces_of_a_daemon_that_is_gone_are_no_daemon(vgrd, gate, tmp_path):
    gate.report(STARTING, age_s=60.0)
    for words in (("status",), ("snapshot", "--out", tmp_path / "x.png")):
        done = vgrd(*words, "--config", tmp_path / "cell.toml")
        assert done.code == 69
        assert "Start it with: vgrd run" in done.err
    assert not (tmp_path / "x.png").exists()
