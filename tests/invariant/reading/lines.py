"""A robot at the line server: its lines, each held against the registers of the same moment."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from tests.invariant.reading.desk import Desk
from tests.invariant.reading.judge import Lie
from tests.invariant.reading.robots import Asked, Link
from tests.invariant.simulation.simulated_time import SimulatedLoop
from vgrd.registers import RotationCode, Status

NOTHING = ["99999.00"] * 3 + ["999.000"] * 3 + ["9999"]
HALF_MM, HALF_DEG = (
    0.00501,
    0.000501,
)  # of the last digit, and of the int32 that it is compared with


class LineRobot(Link):
    """Asks with a TRIG of its own connection, and polls; `counts` are those of the judge."""

    is_line = True

    def __init__(self, loop: SimulatedLoop, desk: Desk, counts: Counter[str]) -> None:
        super().__init__(loop)
        self.desk, self.counts = desk, counts
        self.asked: Asked | None = None
        self.is_new = True

    def on_new(self) -> None:
        self.is_new = True

    def ask(self, asked: Asked, now_s: float) -> None:
        """Start a request."""
        trig = self.asked.trig % 0xFFFF + 1 if self.asked else 1
        self.asked, self.is_new = replace(asked, trig=trig), True
        self.read(now_s)

    def drop(self) -> None:
        """Drop the request, if it is still this one's."""
        if self.send(b"EC,0,0\n") and self.desk.owner is self:
            self.desk.put(None)
        self.asked = None

    def read(self, now_s: float) -> list[str] | None:
        """The fields of the answer, None when there is none: nothing is asked, or nobody is there."""
        if self.asked is None:
            return None
        a = self.asked
        fields = (a.point, a.trig, a.command, 0, a.options, a.max_age_ms, a.max_u95_um)
        answer = self.send(f"EC,{','.join(map(str, fields))}\n".encode()).decode("ascii")
        if not answer:
            return None
        if self.is_new:
            self.is_new = False
            self.desk.put(replace(a, trig=0, at_s=now_s), self)
        self.counts["reads"] += 1
        self.counts["reads of lines"] += 1
        return answer.removesuffix("\n").split(",")

    def compare(self, told: list[str], values: Mapping[str, float], *, is_valid: bool) -> None:
        """Raises Lie unless the line says what the registers say to whom they belong. is_valid: of these."""
        trig, status = map(int, told[:2])
        if self.asked is None or trig != self.asked.trig or int(told[3]) != values["HB"] % 100:
            raise Lie(f"the line {told} beside {values}")
        if status not in (Status.OK, Status.OK_DEGRADED):
            if told[4:] != NOTHING:
                raise Lie(f"a coordinate beside the status of {told}")
            if self.desk.owner is self and is_valid:
                raise Lie(f"the line {told} withholds its own answer {values}")
            return
        self.counts["valid lines"] += 1
        if self.desk.owner is not self or not is_valid or status != values["STATUS"]:
            raise Lie(f"the line {told} says more than the registers {values}")
        self._check_numbers(told, values)

    def _check_numbers(self, told: list[str], values: Mapping[str, float]) -> None:
        rotvec = int(values["FMT"]) & 15 == RotationCode.ROTVEC
        for axis, word in zip(("X", "Y", "Z", "RX", "RY", "RZ"), told[4:10], strict=True):
            exact, half = values[f"EC32_{axis}"] / 1000, HALF_MM
            if axis.startswith("R"):
                number = values[f"EC32_{axis}"]
                exact, half = math.degrees(1e-6 * number) if rotvec else 1e-4 * number, HALF_DEG
            if abs(float(word) - exact) > half + 1e-4 * axis.startswith("R"):
                raise Lie(f"{axis} of the line {told} differs from {exact}")
        same = min(values["EC32_U95"], 9999), min(values["AGE"], 9999)
        if int(told[10]) != same[0] or not 0 <= int(told[2]) - same[1] <= 11:
            raise Lie(f"U95 or AGE of the line {told} differs from {same}")
