"""What error a cell can be expected to have, from its file alone, before anything is bought or taught.

May import calibration, config and judging.
"""

from vgrd.solving.expectation.assumptions import Assumptions
from vgrd.solving.expectation.changes import Change, changes_of
from vgrd.solving.expectation.expectation import TURNS_DEG, Cell, Expectation, expect
from vgrd.solving.expectation.scene import Scene
from vgrd.solving.expectation.wording import report

__all__ = [
    "TURNS_DEG",
    "Assumptions",
    "Cell",
    "Change",
    "Expectation",
    "Scene",
    "changes_of",
    "expect",
    "report",
]
