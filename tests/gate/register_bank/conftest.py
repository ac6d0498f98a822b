"""A register bank whose cell lives."""

import pytest

from tests.gate.register_bank.bench import Bench


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    made.start_cell()
    made.publish()
    return made
