"""Touches as equations, and what all methods read from them.

May import observability and model.
"""

from vgrd.calibration.touches.cad_fit import CadFit, fit_cad, kabsch
from vgrd.calibration.touches.equations import (
    TouchSet,
    equivalent_sigmas,
    studentized_residuals,
    touch_set,
)
from vgrd.calibration.touches.recorded import arm_touches, cad_touches, touched_orientation
from vgrd.calibration.touches.reference import (
    Reference,
    ReferenceTagA,
    find_reference,
    find_reference_tag_a,
    moved_touches,
    turned_touches,
)

__all__ = [
    "CadFit",
    "Reference",
    "ReferenceTagA",
    "TouchSet",
    "arm_touches",
    "cad_touches",
    "equivalent_sigmas",
    "find_reference",
    "find_reference_tag_a",
    "fit_cad",
    "kabsch",
    "moved_touches",
    "studentized_residuals",
    "touch_set",
    "touched_orientation",
    "turned_touches",
]
