"""An expectation in words and numbers, as `vgrd expect --json` writes it."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from vgrd.calibration.joint import tag_b_of
from vgrd.calibration.stated_error import u95_in_words
from vgrd.model import Stability
from vgrd.solving.expectation.changes import Change, changes_of
from vgrd.solving.expectation.expectation import TURNS_DEG, Cell, Expectation, expect
from vgrd.solving.expectation.sight import edge_px, is_in_picture
from vgrd.vision.inspection import LEAST_CELL_PX
from vgrd.vision.print.codes import marker_cells

_GAIN = 0.02  # of the error: what gives less is not worth a change
_NOT_INCLUDED = (
    "a part with play against its tag, a tool that bends, a gripper that does not hold alike, an arm that warms up",
    "a tag that is hidden, smeared or badly lit; a wrong touch; a lens that was touched since",
    "noise that is larger than the cell file and the options say: vgrd solve finds it",
)


def report(
    cell: Cell, expectation: Expectation, limits_mm: tuple[float, float]
) -> dict[str, object]:
    """Everything to tell; limits_mm: `warn_u95_mm` and `max_u95_mm` of the cell file. Raises as `expect`."""
    budget, changes = expectation.budget, changes_of(cell)
    minutes = cell.minutes()
    warn_mm, max_mm = limits_mm
    return {
        "meets": expectation.worst_mm <= max_mm,
        "in_words": in_words(expectation, changes, warn_mm, max_mm),
        "policy": cell.policy.value,
        "u95_includes": u95_in_words(_of(), cell.policy, holes=0, assumes=True),
        "worst": expectation.worst,
        "worst_u95_mm": expectation.worst_mm,
        "warn_u95_mm": warn_mm,
        "max_u95_mm": max_mm,
        **budget.to_json(),
        "targets": [
            {**row, "turn_deg": turn_deg, "meets": error_mm <= max_mm}
            for row, turn_deg, error_mm in zip(
                budget.rows(), expectation.worst_turns_deg, budget.u95_mm.tolist(), strict=True
            )
        ],
        "changes": [asdict(change) for change in changes],
        "minutes": {**minutes, "all": sum(minutes.values())},
        "tag_a_hidden_u95_mm": _without_tag_a_mm(cell),
        "assumed": assumed_of(cell),
        "remarks": list(remarks(cell)),
        "not_included": list(_NOT_INCLUDED),
    }


def in_words(
    expectation: Expectation, changes: list[Change], warn_mm: float, max_mm: float
) -> str:
    """Whether it meets its limit, and what to change first where it does not."""
    worst, worst_mm = expectation.worst, expectation.worst_mm
    if worst_mm <= warn_mm:
        return (
            f"this cell can be expected to meet max_u95_mm {max_mm:g} mm at every target: the worst is {worst} "
            f"with {worst_mm:.2f} mm"
        )
    first = _first_words(expectation, changes)
    if worst_mm <= max_mm:
        return (
            f"this cell can be expected to meet max_u95_mm {max_mm:g} mm at every target, but with OK_DEGRADED "
            f"beyond warn_u95_mm {warn_mm:g} mm: the worst is {worst} with {worst_mm:.2f} mm{first}"
        )
    failing = [name for name, error_mm in expectation.u95_mm.items() if error_mm > max_mm]
    return (
        f"this cell cannot be expected to meet max_u95_mm {max_mm:g} mm at {', '.join(failing)}: the worst is "
        f"{worst} with {worst_mm:.2f} mm, and such answers are refused with 504{first}"
    )


def _first_words(expectation: Expectation, changes: list[Change]) -> str:
    useful = [c for c in changes if c.u95_mm < (1 - _GAIN) * expectation.worst_mm]
    if not useful:
        return "; no single change of the table below helps"
    return f"; first: {useful[0].words}, which gives {useful[0].u95_mm:.2f} mm"


def _without_tag_a_mm(cell: Cell) -> float | None:
    """Error of the worst target where answers rest on the camera's stability alone; None: there is no answer."""
    if cell.facts.camera_stability is Stability.MOVABLE:
        return None
    return expect(cell, tag_a_in_view=False).worst_mm


def assumed_of(cell: Cell) -> dict[str, object]:
    """What was taken for the scene and for teaching, given or not."""
    return {**asdict(cell.assumed), "arm_mm": cell.arm_mm, "tag_b_mm": cell.scene.tag_b_mm}


def remarks(cell: Cell) -> Iterator[str]:
    """What the scene itself shows to be wrong with the cell."""
    scene = cell.scene
    width, height = scene.field_mm()
    seen = f"the camera sees {width:.0f} x {height:.0f} mm at {scene.assumed.distance_mm:.0f} mm"
    now = [tag_b_of(scene.answer(float(np.radians(turn)))) for turn in TURNS_DEG]
    for name, tags in (("tag B", now), ("tag A", scene.looks_seen())):
        if not all(is_in_picture(tag, scene.camera) for tag in tags):
            yield (
                f"{seen}, and {name} leaves the picture: a longer distance, a shorter lens, or a place nearer the "
                "middle"
            )
        cell_px = min(
            (edge_px(tag) / len(marker_cells(tag.tag.family, 0)) for tag in tags), default=np.inf
        )
        if cell_px < LEAST_CELL_PX:
            yield (
                f"the cells of {name} have {cell_px:.1f} px: below {LEAST_CELL_PX:g} px it is hardly found; a "
                "larger tag, a longer lens, or come nearer"
            )


def _of() -> str:
    turns = ", ".join(f"{turn:.0f}" for turn in TURNS_DEG)
    return f"each target, the worst of the object turned by {turns} degrees"
