"""What the stand-ins for the built-ins of all languages share: the functions of mathematics, in degrees."""

import math
from collections.abc import Callable
from typing import Any

MOST_TURNS = 20_000  # of all loops of a run; ours need some hundreds


class StandIns:
    """A routine of the program is called through `run`, so that a language can watch its levels."""

    turns = 0

    def turn_of_loop(self) -> None:
        """Count the turns of loops: one that never ends is found."""
        self.turns += 1
        assert self.turns < MOST_TURNS, "a loop goes on and on"

    def run(self, routine: Callable[..., Any], *arguments: Any) -> Any:
        return routine(*arguments)

    def abs(self, number: float) -> float:
        return abs(number)

    def sqrt(self, number: float) -> float:
        return math.sqrt(number)

    def sin(self, degrees: float) -> float:
        return math.sin(math.radians(degrees))

    def cos(self, degrees: float) -> float:
        return math.cos(math.radians(degrees))
