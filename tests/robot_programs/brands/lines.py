"""The line server's own language, in front of the cell of the tests."""

import math

from tests.robot_programs.brands.world import Reading, World
from vgrd.lines import Frame, cut, read
from vgrd.lines.answering import NO_DEG, NO_MM

BARE = "{0},{1},{2},{3},{4},{5},{6},{7},{8},{9},{10}"
XML = (
    '<Vgrd Echo="{0}" Status="{1}" Age="{2}" Hb="{3}" U95="{10}">'
    '<Ec X="{4}" Y="{5}" Z="{6}" A="{9}" B="{8}" C="{7}"/></Vgrd>'
)
OPTIONS = {Frame.BARE: 16, Frame.XML: 32}  # roll, pitch, yaw; A, B, C


class LineServer:
    """Reads a request as the real one does, and answers it at once, also what the real one never would."""

    def __init__(self, world: World) -> None:
        self.world = world

    def answer(self, request: str) -> str:
        """Return the answer with its end; nothing where the link is lost. Raises what the real one raises."""
        piece = cut(request.encode("ascii"))
        assert piece is not None, "a request without its end"
        assert piece.length == len(request)
        asked = read(piece)
        values = asked.values
        assert values["OPT"] == OPTIONS[piece.frame]
        assert values["OBJECT"] == 0
        self.world.ask(asked.trig, values["POINT"], values["CMD"], values["OPT"])
        reading = self.world.read()
        form = XML if piece.frame is Frame.XML else BARE
        answer = form.format(*fields(reading)) + piece.end
        return self.world.garbled(answer) if reading.link else ""


def fields(reading: Reading) -> list[str]:
    """Return the eleven fields of an answer, rotations as roll, pitch, yaw."""
    echo = reading.trig if reading.echo is None else reading.echo
    good = [math.isfinite(number) and reading.good for number in reading.pose]
    mm = [n if ok else NO_MM for n, ok in zip(reading.pose[:3], good[:3], strict=True)]
    deg = [n if ok else NO_DEG for n, ok in zip(reading.pose[3:], good[3:], strict=True)]
    head = [str(echo), str(reading.status), str(int(reading.age_ms)), str(reading.beat % 100)]
    return [*head, *(f"{n:.2f}" for n in mm), *(f"{n:.3f}" for n in deg), str(int(reading.u95_um))]
