"""Touches in a TOML file, TCP out: `vgrd tcp`.

May import documents, calibration and judging.
"""

from vgrd.solving.touch_files.document import TouchFile, TouchKind, load_touches
from vgrd.solving.touch_files.solution import TouchSolution
from vgrd.solving.touch_files.solving import solve_touches

__all__ = ["TouchFile", "TouchKind", "TouchSolution", "load_touches", "solve_touches"]
