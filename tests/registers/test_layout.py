"""The map of the registers holds together, and its documentation is of today."""

from pathlib import Path

import pytest

from vgrd.registers.document import document
from vgrd.registers.layout import Block, Field


def test_fields_that_overlap_are_refused():
    with pytest.raises(ValueError, match="overlaps"):
        Block(0, 4, [Field("A", 0, "u32", ""), Field("B", 1, "u16", "")])


def test_the_documentation_of_the_registers_is_up_to_date():
    path = Path(__file__).parents[2] / "docs" / "registers.md"
    assert path.read_text() == document(), (
        "run: python -m vgrd.registers.document docs/registers.md"
    )
