"""Which plans a cell can be taught by."""

from vgrd.errors import InputError
from vgrd.model import CellFacts, Plan, Stability


def check_plan(plan: Plan, facts: CellFacts) -> None:
    """InputError for the paper's plans where the camera may move: their steps take it to stand still."""
    if plan is not Plan.JOINT and facts.camera_stability is Stability.MOVABLE:
        raise InputError(
            f"plan {plan.value} needs a camera that stands still while teaching, and camera.stability is "
            "movable: teach with plan joint, or fasten the camera and set it to fixed"
        )
