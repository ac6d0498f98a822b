"""The computer that was, and the one that takes its place."""

from pathlib import Path

import pytest

from tests.backup.computer import CELL, Computer


@pytest.fixture
def old(tmp_path: Path) -> Computer:
    computer = Computer(tmp_path / "old")
    computer.cell_file.write_text(CELL)
    computer.teach(1)
    computer.teach(2)
    return computer


@pytest.fixture
def spare(tmp_path: Path) -> Computer:
    return Computer(tmp_path / "spare")
