"""Touches of a recording that contradict CAD, and the mistake in CAD or its names that explains them."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from vgrd.calibration.checks.cad_mistakes import (
    ConstantWrist,
    VariedWrists,
    misinterpretation,
)
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.touches import arm_touches, cad_touches
from vgrd.calibration.universal import lowest_cost, reduced_cost
from vgrd.geometry import Array
from vgrd.judging.thresholds import NOISY_SCALE
from vgrd.model import Finding, Recording, Touch

_MIN_TOUCHES = 4  # fewer fit every order of the targets
_SHOWS = (
    6.0  # sigmas: beyond this a session is refused as contradictory (`joint_system.WRONG_SIGMA`)
)


def misinterpreted_points(recording: Recording) -> Finding | None:
    """Mirrored CAD points, two targets swapped, or their order wrong; None where nothing shows it.

    Four touches are the least, five where the wrists vary; touches about one axis tell nothing.
    """
    indices, points = cad_touches(recording)
    touches = [recording.touches[i] for i in indices]
    targets = recording.facts.object.targets
    axes = turned_axes([t.base_from_wrist.rotation for t in touches] or [np.eye(3)])[0]
    if len(touches) < _MIN_TOUCHES + (axes is Axes.MANY) or axes is Axes.ONE:
        return None
    arrays = arm_touches(touches, recording)
    wrists = ConstantWrist(arrays) if axes is Axes.NONE else VariedWrists(arrays)
    scale = wrists.scatter(points)
    if not NOISY_SCALE < scale < np.inf:
        return None
    names = [f"{i + 1} ({touch.target})" for i, touch in zip(indices, touches, strict=True)]
    places = [list(targets).index(touch.target) for touch in touches]
    return misinterpretation(names, points, wrists, scale, places)


def rival_names(recording: Recording) -> str:
    """Which wrong names the touches would not show, in words; "" where every single mistake would.

    Two targets exchanged all through, or one touch of another target than it says. A flat list of
    targets that is mirrored as a whole never shows (`misinterpretation`).
    """
    if not recording.facts.object.has_cad:
        return "no target is in CAD, so that the touches would not show a wrong name"
    indices, _ = cad_touches(recording)
    touches = [recording.touches[i] for i in indices]
    names = [touch.target for touch in touches]
    if len(touches) < _MIN_TOUCHES:
        return (
            f"{len(touches)} touches of targets in CAD would not show that targets were exchanged: "
            f"touch {_MIN_TOUCHES} or more"
        )
    targets = recording.facts.object.targets
    cad = {name: t.cad for name, t in targets.items() if t.point_in_object is not None}
    arrays = arm_touches(touches, recording)
    least = _SHOWS**2 * max(arrays.equations() - _unknowns(touches), 1)
    numbers = [int(i) + 1 for i in indices]
    for mistake, other_names in _mistakes(numbers, names, sorted(cad)):
        points: Array = np.array([cad[name] for name in other_names])
        if not lowest_cost(reduced_cost(points, arrays)) > least:
            return f"the touches would not show it if {mistake}: touch another target"
    return ""


def _unknowns(touches: Sequence[Touch]) -> int:
    """How many unknowns touches of these wrists determine: a pose, and the TCP as far as it shows."""
    wrists = [touch.base_from_wrist.rotation for touch in touches]
    return 6 + {Axes.NONE: 0, Axes.ONE: 2, Axes.MANY: 3}[turned_axes(wrists)[0]]


def _mistakes(
    numbers: list[int], names: list[str], targets: list[str]
) -> Iterator[tuple[str, list[str]]]:
    """Every single mistake in words, and the names as they would have been meant."""
    for a, b in combinations(sorted(set(names)), 2):
        other_names = [{a: b, b: a}.get(name, name) for name in names]
        yield f"{a} and {b} were exchanged", other_names
    for i, (number, name) in enumerate(zip(numbers, names, strict=True)):
        for other in targets:
            if other != name:
                other_names = [*names[:i], other, *names[i + 1 :]]
                yield f"touch {number} was of {other}, not of {name}", other_names
