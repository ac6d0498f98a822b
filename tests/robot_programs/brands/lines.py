"""The line server as its document says it, on the world of the tests."""

import math
import xml.etree.ElementTree as ET

from tests.robot_programs.brands.world import Reading, World

SENTINEL_MM = "99999.00"
SENTINEL_DEG = "999.000"
XML_ANSWER = (
    '<Vgrd Echo="{0}" Status="{1}" Age="{2}" Hb="{3}" U95="{10}">'
    '<Ec X="{4}" Y="{5}" Z="{6}" A="{9}" B="{8}" C="{7}"/></Vgrd>'
)


class LineServer:
    """Answers a request at once."""

    def __init__(self, world: World) -> None:
        self.world = world

    def answer(self, request: str) -> str:
        """Return the answer to a line, with its end; nothing where the link is lost."""
        assert request.endswith("\n")
        assert len(request) <= 80
        verb, point, trig, command, object_, options = request.rstrip("\n").split(",")
        assert (verb, object_, options) == ("EC", "0", "16"), "roll, pitch, yaw"
        self.world.ask(int(trig), int(point), int(command), int(options))
        reading = self.world.read()
        return self.world.garbled(",".join(fields(reading)) + "\n") if reading.link else ""

    def answer_xml(self, request: str) -> str:
        """Return the document that answers one of EKI; nothing where the link is lost."""
        ask = ET.fromstring(request)  # noqa: S314, from the program under test
        assert ask.tag == "Ask"
        options = int(ask.get("Opt", "32"))
        assert options == 32, "A, B, C"
        self.world.ask(
            int(ask.attrib["Trig"]), int(ask.attrib["Point"]), int(ask.get("Cmd", "2")), options
        )
        reading = self.world.read()
        return self.world.garbled(XML_ANSWER.format(*fields(reading))) if reading.link else ""


def fields(reading: Reading) -> list[str]:
    """Return the eleven fields of an answer, rotations as roll, pitch, yaw."""
    echo = reading.trig if reading.echo is None else reading.echo
    good = [math.isfinite(number) and reading.good for number in reading.pose]
    mm = [
        f"{n:.2f}" if ok else SENTINEL_MM for n, ok in zip(reading.pose[:3], good[:3], strict=True)
    ]
    deg = [
        f"{n:.3f}" if ok else SENTINEL_DEG
        for n, ok in zip(reading.pose[3:], good[3:], strict=True)
    ]
    head = [str(echo), str(reading.status), str(int(reading.age_ms)), str(reading.beat % 100)]
    return [*head, *mm, *deg, str(int(reading.u95_um))]
