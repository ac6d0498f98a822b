"""Answers of the line server: what they say is what the registers say, and none is longer than 80 characters."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.lines import LONGEST_LINE, Frame, answer_text
from vgrd.lines.document import document
from vgrd.registers import Answer, RotationCode, Status

ENDS = ("\n", "\r\n")
LONGEST = replace(
    Answer(Status.OK),
    captured_s=-1e9,
    position_um=(-9_999_990, -9_999_990, -9_999_990),
    rotation=(-179.9999, -179.9999, -179.9999),
    rotation_format=RotationCode.ZYZ,
)
answers = st.builds(
    Answer,
    status=st.sampled_from(Status),
    captured_s=st.one_of(st.just(math.nan), st.floats(-1e6, 1e6)),
    position_um=st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 3),
    rotation=st.tuples(*[st.floats(-180, 180)] * 3),
    u95_um=st.integers(0, 2**31 - 1),
    rotation_format=st.sampled_from(RotationCode),
)


def fields(text: str, frame: Frame) -> list[str]:
    if frame is Frame.BRACKETS:
        assert text.startswith("(")
        assert text.endswith(")")
        return text[1:-1].split(",")
    return text.split(",")


@given(answers, st.integers(0, 65535), st.integers(0, 2**40), st.sampled_from(Frame))
def test_every_answer_is_plain_numbers_and_a_coordinate_stands_only_beside_a_good_status(
    answer, trig, beat, frame
):
    rotvec = answer.rotation_format is RotationCode.ROTVEC
    answer = (
        replace(answer, rotation=tuple(map(math.radians, answer.rotation))) if rotvec else answer
    )
    text = answer_text(frame, trig, answer, beat, 0.0)
    if frame is Frame.XML:
        assert len(text) < 2 * LONGEST_LINE
        return
    assert len(text + "\r\n") <= LONGEST_LINE
    words = fields(text, frame)
    assert len(words) == 11
    assert not set("".join(words)) - set("-.0123456789")
    x, y, z, *angles = map(float, words[4:10])
    assert int(words[0]) == trig
    if int(words[1]) in (1, 2):
        assert answer.status.is_ok
        assert (x, y, z) == pytest.approx([um / 1000 for um in answer.position_um], abs=0.0051)
        told = map(math.degrees, answer.rotation) if rotvec else answer.rotation
        assert angles == pytest.approx(list(told), abs=0.00051)
        assert int(words[10]) == min(answer.u95_um, 9999)
    else:
        assert (x, y, z, *angles) == (99999.0,) * 3 + (999.0,) * 3
        assert words[10] == "9999"


@pytest.mark.parametrize("frame", [Frame.BARE, Frame.BRACKETS])
@pytest.mark.parametrize("end", ENDS)
def test_the_longest_line_has_80_characters_with_its_end(frame, end):
    """All fields at their widest; a string of RAPID holds no more."""
    text = answer_text(frame, 65535, LONGEST, 99, 0.0)
    assert text.count("-9999.99") == text.count("-180.000") == 3
    wide = text.replace(",1,", ",503,") + end  # no STATUS is longer
    assert len(wide) == 80 - 2 * (frame is Frame.BARE) - (end == "\n")


def test_a_coordinate_that_the_line_cannot_hold_is_refused_there():
    beyond = replace(LONGEST, position_um=(0, 9_999_991, 0))
    assert answer_text(Frame.BARE, 1, beyond, 0, 0.0).startswith("1,602,9999,0,99999.00,")


def test_age_runs_on_and_is_rounded_up():
    answer = Answer(Status.OK, captured_s=1.0, valid_until_s=2.0)
    ages = [
        answer_text(Frame.BARE, 1, answer, 0, now).split(",")[2] for now in (1.0, 1.0621, 12.0)
    ]
    assert ages == ["0", "63", "9999"]


def test_the_documentation_of_the_lines_is_up_to_date():
    path = Path(__file__).parents[2] / "docs" / "line-server.md"
    assert path.read_text(encoding="utf-8") == document(), (
        "run python -m vgrd.lines.document docs/line-server.md"
    )
