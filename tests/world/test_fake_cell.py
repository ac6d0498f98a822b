"""The fake cell as a resource: it starts, and it ends in an order in which nothing is used that has ended."""

import threading
import time
from pathlib import Path

import pytest

from fakes.camera.scene import SnapshotWriter
from fakes.cell.cell import FakeCell
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.world import World


def test_the_controller_ends_before_the_ring_it_publishes_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception in the controller's thread is an error of this test (pytest's own rule)."""
    close = SnapshotWriter.close

    def close_and_wait(writer: SnapshotWriter) -> None:
        close(writer)
        time.sleep(0.1)  # twenty-five periods in which a controller that runs on would publish

    monkeypatch.setattr(SnapshotWriter, "close", close_and_wait)
    with FakeCell(World(Layout(), seed=0), tmp_path, free_port(), camera="pylon"):
        pass
    assert "controller" not in [thread.name for thread in threading.enumerate()]
