"""Which plans a cell can be taught by."""

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry.coincidence import are_in_line
from vgrd.judging.thresholds import LINE
from vgrd.model import CellFacts, Plan, Stability

_FEW = 3  # the least of a rigid fit


def check_plan(plan: Plan, facts: CellFacts) -> None:
    """InputError for a plan that cannot solve such a cell.

    The paper's steps take the camera to stand still; its universal method needs CAD of three targets.
    """
    if plan is not Plan.JOINT and facts.camera_stability is Stability.MOVABLE:
        raise InputError(
            f"plan {plan.value} needs a camera that stands still while teaching, and camera.stability is "
            "movable: teach with plan joint, or fasten the camera and set it to fixed"
        )
    targets = facts.object.targets.values()
    points = [target.point_in_object for target in targets if target.point_in_object is not None]
    bare = facts.object.bare
    if (
        plan is Plan.UNIVERSAL
        and bare
        and (len(points) < _FEW or are_in_line(np.array(points), LINE))
    ):
        raise InputError(
            f"plan universal finds the TCP from the CAD of {_FEW} targets that are not on one line, and "
            f"{', '.join(bare)} have no point_mm: give it, or teach with plan joint"
        )
