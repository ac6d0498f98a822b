"""Whether what the tool holds goes into its hole: the paper's bottle of 11.6 mm in a hole of 12 mm.

Half the clearance is the gap on each side: within it nothing touches. Bottle and gripper give a little and
the bottle's bottom is round, so within the whole clearance it still goes in (the paper, VI-B 3).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.model import ExpectedCoordinate, Tool

CLEAN_SHARE = 0.5  # of the clearance: the gap on each side
_ANGLES = 720  # of the integral; exact to 1e-6 where one sigma is up to 100 times the other
_WHOLE_TURN = np.linspace(0, 2 * np.pi, _ANGLES, endpoint=False)
_LEAST = 1e-2  # of the larger sigma: a thinner ellipse is a line, to a thousandth of its length


@dataclass(frozen=True, slots=True)
class Insertion:
    """Probabilities that it goes in without contact, and that it does not go in; the rest goes in with contact."""

    clean: float
    failed: float

    @property
    def touching(self) -> float:
        """Goes in, but touches the rim."""
        return 1.0 - self.clean - self.failed

    def to_json(self) -> dict[str, float]:
        """By name."""
        return {"clean": self.clean, "touching": self.touching, "failed": self.failed}


def mean_insertion(odds: Sequence[Insertion]) -> Insertion:
    """Of many that count alike."""
    return Insertion(
        float(np.mean([each.clean for each in odds])),
        float(np.mean([each.failed for each in odds])),
    )


def insertion_of(
    expected: ExpectedCoordinate, tool: Tool, clearance_mm: float | None
) -> Insertion | None:
    """What to expect of one expected coordinate; None for a target without a clearance.

    The covariance is the flange's: where the wrist turns with the object (policy follow) the tip is better known.
    """
    if clearance_mm is None:
        return None
    axis = expected.base_from_wrist.rotation @ np.asarray(tool.axis_in_wrist)
    return insertion_odds(expected.position_covariance, axis, clearance_mm)


def insertion_odds(covariance: Array, axis: Array, clearance_mm: float) -> Insertion:
    """Odds for a centred normal miss with a covariance (3, 3), mm^2; axis (3,): of the tool, same frame.

    Only what is across the axis counts. Raises InputError on a clearance that is no length.
    """
    if not (0 < clearance_mm < np.inf):
        raise InputError(f"a clearance of {clearance_mm} mm: it must be a length above zero")
    across = np.linalg.svd(np.asarray(axis)[None])[2][1:]
    variances = np.linalg.eigvalsh(across @ covariance @ across.T)
    return Insertion(
        clean=_share_within(CLEAN_SHARE * clearance_mm, variances),
        failed=1.0 - _share_within(clearance_mm, variances),
    )


def _share_within(radius: float, variances: Array) -> float:
    """Probability that a centred normal of two variances lies in a circle: the integral in polar coordinates."""
    widest = float(variances.max())
    if widest <= 0:
        return 1.0
    narrow, wide = np.maximum(variances, _LEAST**2 * widest)
    q = np.cos(_WHOLE_TURN) ** 2 / narrow + np.sin(_WHOLE_TURN) ** 2 / wide
    whole = -np.expm1(-0.5 * radius**2 * q) / q
    return float(min(whole.mean() / np.sqrt(narrow * wide), 1.0))
