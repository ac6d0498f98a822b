"""What the programs are tried with is what the line server says."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from tests.robot_programs.brands.krl import CHANNEL
from tests.robot_programs.brands.lines import BARE, XML, fields
from tests.robot_programs.brands.world import SERVED, Reading
from vgrd.lines import Frame, answer_text
from vgrd.registers import Answer, RotationCode, Status

NOW_S = 50.0
GOOD = Reading(7, 1, 1234, 7, 0, SERVED)
REFUSED = replace(GOOD, status=302, u95_um=9999)


def answer(reading, rotation_format):
    rotation = SERVED[3:] if rotation_format is RotationCode.RPY else SERVED[:2:-1]
    return Answer(
        Status(reading.status),
        echo=reading.trig,
        captured_s=NOW_S - reading.age_ms / 1000,
        position_um=tuple(round(1000 * mm) for mm in reading.pose[:3]),
        rotation=rotation,
        u95_um=reading.u95_um,
        rotation_format=rotation_format,
    )


@pytest.mark.parametrize(
    "reading",
    [GOOD, replace(GOOD, status=2), REFUSED, replace(REFUSED, status=10)],
    ids=lambda reading: str(reading.status),
)
@pytest.mark.parametrize(
    ("form", "frame", "rotation_format"),
    [(BARE, Frame.BARE, RotationCode.RPY), (XML, Frame.XML, RotationCode.KUKA_ABC)],
    ids=["bare", "xml"],
)
def test_answers_are_those_of_the_line_server(reading, form, frame, rotation_format):
    said = answer_text(frame, reading.trig, answer(reading, rotation_format), reading.beat, NOW_S)
    assert form.format(*fields(reading)) == said


def test_the_channel_of_kuka_reads_all_that_a_document_holds_and_no_more():
    said = answer_text(Frame.XML, 7, answer(GOOD, RotationCode.KUKA_ABC), 1, NOW_S)
    root = ET.fromstring(said)  # noqa: S314, our own
    held = {f"{root.tag}/@{name}" for name in root.attrib}
    held |= {f"{root.tag}/{child.tag}/@{name}" for child in root for name in child.attrib}
    channel = ET.parse(CHANNEL).getroot()  # noqa: S314, idem
    elements = channel.iterfind("RECEIVE/XML/ELEMENT")
    assert {tag for e in elements if "/@" in (tag := e.attrib["Tag"])} == held
