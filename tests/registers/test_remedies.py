"""At every status people find what to do, and only there."""

from pathlib import Path

import pytest

from vgrd.registers import Status
from vgrd.registers.remedies import REMEDIES, document, superfluous

PAGE = Path(__file__).parents[2] / "docs" / "status-codes.md"


def test_the_page_is_as_the_table() -> None:
    remedy = "run: python -m vgrd.registers.remedies docs/status-codes.md"
    assert PAGE.read_text(encoding="utf-8") == document(), remedy


@pytest.mark.parametrize("status", Status, ids=lambda status: status.name)
def test_every_status_says_what_operator_and_integrator_do(status: Status) -> None:
    remedy = REMEDIES[status.name]
    assert all(remedy)
    (line,) = [line for line in document().splitlines() if line.startswith(f"| {int(status)} ")]
    assert line.count(" | ") == 3
    assert remedy.operator in line


def test_no_remedy_is_for_a_status_that_never_was() -> None:
    assert superfluous() == set()


def test_the_codes_that_a_person_must_confirm_say_so() -> None:
    confirmed = {name for name, remedy in REMEDIES.items() if "vgrd confirm" in remedy.operator}
    assert confirmed == {"TCP_OFFSET_CHANGED", "CALIBRATION_DRIFT"}  # those that faults.py latches
