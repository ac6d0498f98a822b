"""What to take while nothing can be estimated yet: the plan's samples in their order, each look turned anew."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vgrd.calibration.observability import Axes, turned_axes
from vgrd.geometry import Array, exp_rotation, log_rotation
from vgrd.geometry.coincidence import equal_poses
from vgrd.model import CellFacts, Observation, Plan, Recording, Stability

WANTED: Mapping[Plan, Mapping[str, int]] = MappingProxyType(
    {  # chosen; fewer looks are solved too
        Plan.UNIVERSAL: {"look": 8, "touch": 6},
        Plan.SPECIAL: {"look": 8, "spin": 4, "touch": 6},
        Plan.CONVENTIONAL: {"look": 8, "point": 8, "touch": 6},
        Plan.PLANE: {"look": 8, "point": 16, "touch": 6},
        Plan.SPHERE: {"look": 8, "point": 16, "touch": 6},
        Plan.JOINT: {"look": 8, "spin": 4, "touch": 8},
    }
)
_TURN_DEG = 25.0  # large enough to tell an axis, small enough to keep the tag in view
_WIDEST_RAD = np.radians(
    50
)  # from the first look: a tag that faced the camera there is still found
_FAINT_RAD = np.radians(3)  # turns about an axis below it tell next to nothing
_SAME_MM, _SAME_RAD = 0.1, 2e-4  # as of a rest: the flange did not move
_YAWS = 4  # looks about one axis: an arm of four axes, or an operator who wants no other turn
_AXES = "XYZ"


def wanted(plan: Plan, facts: CellFacts) -> dict[str, int]:
    """By kind of sample how many the plan asks for; a movable camera tells nothing by tag A alone."""
    kinds = dict(WANTED[plan])
    if facts.camera_stability is Stability.MOVABLE:
        kinds.pop("look", None)
    return kinds


def first_sample(recording: Recording) -> str:
    """The next sample of the plan, in words; "" where it has all that are asked for."""
    looks = _distinct(recording.looks)
    have = {
        "look": len(looks),
        "spin": len(recording.spins),
        "point": len(recording.points),
        "touch": len(recording.touches),
    }
    for kind, count in wanted(recording.plan, recording.facts).items():
        if have[kind] < count:
            what = _next_look(looks) if kind == "look" else _WORDS[kind]
            return f"{kind} {have[kind] + 1} of {count}: {what}"
    return ""


_WORDS = {
    "spin": "turn the object by about 90 degrees from where it stood, tag B in view (vgrd spin)",
    "point": "touch beside the object with the wrist turned otherwise than before (vgrd point NAME)",
    "touch": "touch the target with the fewest touches (vgrd touch NAME)",
}


def _next_look(looks: Sequence[Observation]) -> str:
    if not looks:
        return "turn tag A to the camera, near the object, and let the arm stand (vgrd look)"
    axis, sign = _most_telling([look.base_from_wrist.rotation for look in looks])
    return (
        f"turn the wrist by {sign * _TURN_DEG:.0f} degrees about base {_AXES[axis]} from where it stood for "
        "the last look, tag A in view (vgrd look)"
    )


def _most_telling(rotations: Sequence[Array]) -> tuple[int, int]:
    """Axis of the base (0 to 2) and side of the turn that spreads the orientations the most; in view if any is."""
    only_yaws = len(rotations) >= _YAWS and turned_axes(rotations)[0] is Axes.ONE
    axes = (2,) if only_yaws else (0, 1, 2)
    candidates = [(axis, sign) for axis in axes for sign in (1, -1)]

    def worth(candidate: tuple[int, int]) -> tuple[bool, float]:
        axis, sign = candidate
        turn = exp_rotation(sign * np.radians(_TURN_DEG) * np.eye(3)[axis])
        R = turn @ rotations[-1]
        turns = np.array([log_rotation(one @ rotations[0].T) for one in (*rotations, R)])
        spread = np.cov(turns.T, bias=True) + _FAINT_RAD**2 * np.eye(3)
        is_near = bool(np.linalg.norm(turns[-1]) <= _WIDEST_RAD)
        return is_near, float(np.linalg.slogdet(spread)[1])

    return max(candidates, key=worth)


def _distinct(looks: Sequence[Observation]) -> list[Observation]:
    """The first look from every place."""
    same = equal_poses([look.base_from_wrist for look in looks], _SAME_MM, _SAME_RAD)
    return [look for i, look in enumerate(looks) if not same[i, :i].any()]
