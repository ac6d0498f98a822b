"""The taught cell that the tests of this room share, and a bench of its own for each of them."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cell.serving.bench import Bench, Taught


@pytest.fixture(scope="session")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Taught:
    return Taught(tmp_path_factory.mktemp("taught"))


@pytest.fixture
def bench(tmp_path: Path, taught: Taught) -> Iterator[Bench]:
    bench = Bench(tmp_path, taught)
    yield bench
    with contextlib.suppress(ValueError):
        bench.reader.close()
