"""How exactly a print is as drawn, where nobody has measured it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PrintTolerance:
    """Standard deviations of a print.

    size: of its size in x and in y, each, as a share of it; ink_mm: how far ink spreads over an edge.
    """

    size: float = (
        0.001  # a steel rule tells 0.1 mm in 100 mm, and paper grows by as much in damp air
    )
    ink_mm: float = (
        0.01  # half of what office printers spread; a picture tells it ten times better
    )
