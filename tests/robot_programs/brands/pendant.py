"""TP of FANUC, the few lines of it that our program uses, run as they stand."""

import operator
import re
from collections.abc import Callable
from types import SimpleNamespace

from tests.robot_programs.brands.translation import NotUnderstoodError
from tests.robot_programs.brands.world import World

_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    ">=": operator.ge,
    "<": operator.lt,
}
_LINE = re.compile(r"^\s*\d+:(.*);\s*$", re.MULTILINE)
_NAME = re.compile(r"\[(\d+(?:,\d)?):[^\]]*\]")  # R[84:WORD] is R[84]
_SQUARE = r"PR\[\d+,[1-3]\]\*PR\[\d+,[1-3]\]"


class Pendant:
    """Registers, position registers, flags, and a program that goes from line to line."""

    def __init__(self, source: str, world: World) -> None:
        self.world = world
        lines = [_NAME.sub(r"[\1]", line).strip() for line in _LINE.findall(source)]
        self.lines = [line for line in lines if line and not line.startswith("!")]
        self.labels = {
            int(m[1]): i
            for i, line in enumerate(self.lines)
            if (m := re.fullmatch(r"LBL\[(\d+)\]", line))
        }
        self.numbers: dict[int, float] = {}
        self.places: dict[int, SimpleNamespace] = {}
        self.flags: dict[int, bool] = {}
        self.settings: dict[str, int] = {}
        self.off: dict[int, tuple[float, ...]] = {}
        self.at = 0

    def run(self) -> None:
        """Go from line to line, to the end."""
        self.at = 0
        while self.at < len(self.lines):
            line = self.lines[self.at]
            self.at += 1
            if not any(self._try(pattern, step, line) for pattern, step in _STEPS):
                raise NotUnderstoodError(f"TP: {line}")

    def _try(
        self, pattern: str, step: Callable[["Pendant", re.Match[str]], None], line: str
    ) -> bool:
        match = re.fullmatch(pattern, line)
        if match:
            step(self, match)
        return bool(match)

    def value(self, text: str) -> float:
        """R[n], R[n]+1 or a number."""
        if match := re.fullmatch(r"R\[(\d+)\](?:\+(\d+))?", text):
            return self.numbers[int(match[1])] + int(match[2] or 0)
        return float(text)

    def holds(self, text: str) -> bool:
        """R[n] compared with something."""
        match = re.fullmatch(r"(R\[\d+\])(=|<>|>=|<)(\S+)", text)
        if not match:
            raise NotUnderstoodError(f"TP: {text}")
        return _COMPARISONS[match[2]](self.value(match[1]), self.value(match[3]))

    def jump(self, label: str) -> None:
        self.at = self.labels[int(label)]

    def setting(self, match: re.Match[str]) -> None:
        self.settings[match[1]] = int(match[2])

    def assign(self, match: re.Match[str]) -> None:
        self.numbers[int(match[1])] = self.value(match[2])

    def jump_if(self, match: re.Match[str]) -> None:
        if self.holds(match[1]):
            self.jump(match[2])

    def subtract(self, match: re.Match[str]) -> None:
        """A place less another; LPOS is where the arm stands."""
        there = self._place(match[2])
        pairs = zip(self.world.stands_at, there, strict=True)
        self.off[int(match[1])] = tuple(here - place for here, place in pairs)

    def jump_if_far(self, match: re.Match[str]) -> None:
        """Mixed logic: the sum of the squares of X, Y and Z of a PR, compared with a register."""
        elements = re.findall(r"PR\[(\d+),(\d)\]", match[1])
        numbers = [self.off[int(place)][int(axis) - 1] for place, axis in elements]
        squares = (a * b for a, b in zip(numbers[::2], numbers[1::2], strict=True))
        if sum(squares) > self.value(match[2]):
            self.jump(match[3])

    def wait(self, match: re.Match[str]) -> None:
        if not self.world.wait(lambda: self.holds(match[1]), self.settings["$WAITTMOUT"] / 100):
            self.jump(match[2])

    def pause(self, match: re.Match[str]) -> None:
        self.world.told.append("pause")
        self.world.advance(float(match[1]))

    def skip_condition(self, match: re.Match[str]) -> None:
        self.flag = int(match[1])

    def move(self, match: re.Match[str]) -> None:
        assert self.settings["UFRAME_NUM"] == 0
        assert self.settings["UTOOL_NUM"] == 10
        self.world.go(self._place(match[2]), way="free" if match[1] == "J" else "straight")

    def leg(self, match: re.Match[str]) -> None:
        """With Skip: goes on behind when the condition came, jumps when the end was reached without."""
        if self.world.go(self._place(match[1]), lambda: not self.flags[self.flag]):
            self.jump(match[2])

    def _place(self, number: str) -> tuple[float, ...]:
        place = self.places[int(number)]
        return (place.x, place.y, place.z)


_STEPS: tuple[tuple[str, Callable[[Pendant, re.Match[str]], None]], ...] = (
    (r"LBL\[\d+\]", lambda _pendant, _match: None),
    (r"MESSAGE\[.{1,24}\]", lambda _pendant, _match: None),
    (r"JMP LBL\[(\d+)\]", lambda pendant, match: pendant.jump(match[1])),
    (r"(UFRAME_NUM|UTOOL_NUM|\$WAITTMOUT)=(\d+)", Pendant.setting),
    (r"R\[(\d+)\]=(\S+)", Pendant.assign),
    (r"PR\[(\d+)\]=LPOS-PR\[(\d+)\]", Pendant.subtract),
    (
        rf"IF \(({_SQUARE}(?:\+{_SQUARE})*)>(R\[\d+\])\),JMP LBL\[(\d+)\]",
        Pendant.jump_if_far,
    ),
    (r"IF (\S+),JMP LBL\[(\d+)\]", Pendant.jump_if),
    (r"WAIT (\S+) TIMEOUT,LBL\[(\d+)\]", Pendant.wait),
    (r"WAIT +(\.\d+)\(sec\)", Pendant.pause),
    (r"SKIP CONDITION F\[(\d+)\]=OFF", Pendant.skip_condition),
    (r"([JL]) PR\[(\d+)\] \d+(?:%|mm/sec) FINE", Pendant.move),
    (r"L PR\[(\d+)\] \d+mm/sec FINE Skip,LBL\[(\d+)\]", Pendant.leg),
    (r"PAUSE", lambda pendant, _match: pendant.world.halt()),
)
