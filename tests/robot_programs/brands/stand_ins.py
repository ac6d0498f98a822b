"""What the stand-ins for the built-ins of all languages share: the functions of mathematics, in degrees."""

import math
from collections.abc import Callable
from typing import Any


class StandIns:
    """A routine of the program is called through `run`, so that a language can watch its levels."""

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
