"""One taught fake cell with its daemon, shared by the tests that leave it alive."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from fakes.daemon import Daemon
from fakes.taught import TaughtCell, rehearse
from vgrd.model import Calibration


class Live(NamedTuple):
    """A taught fake cell and the daemon that serves it."""

    cell: TaughtCell
    daemon: Daemon


@pytest.fixture(scope="session")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    return rehearse(tmp_path_factory.mktemp("rehearsal"))


@pytest.fixture
def taught(tmp_path: Path, calibration: Calibration) -> Iterator[TaughtCell]:
    """A cell of one's own, its daemon not started."""
    with TaughtCell(tmp_path / "cell", calibration) as cell:
        yield cell


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory, calibration: Calibration) -> Iterator[Live]:
    with (
        TaughtCell(tmp_path_factory.mktemp("live"), calibration) as cell,
        cell.daemon() as daemon,
    ):
        yield Live(cell, daemon)


@pytest.fixture
def live(shared: Live) -> Live:
    """The shared cell, put back as it was at the start; a test may do to it what heals."""
    shared.cell.restore(shared.daemon)
    return shared
