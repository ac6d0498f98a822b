"""All rules: importing their rooms fills the table."""

from tests.invariant.rules import accidents, asking, breakdowns
from tests.invariant.rules.table import RULES

ROOMS = (accidents, asking, breakdowns)

__all__ = ["RULES"]
