"""A touch against a calibration: how far the tip is from each target that it can serve."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.errors import CalibrationError, Contradiction, InputError, TagNotSeen
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import PLAUSIBLE
from vgrd.model import CameraPlace, CellFacts, Policy, TagObservation, Touch

_OPEN_MM = 1e4  # sigma of a direction that a touch did not measure: larger than any cell


@dataclass(frozen=True, slots=True, eq=False)
class Miss:
    """The tip minus a target (3,), mm in the base; square: of it in sigmas, of three degrees of freedom."""

    off: Array
    covariance: Array
    square: float

    @property
    def mm(self) -> float:
        """Length of it."""
        return float(np.linalg.norm(self.off))

    @property
    def is_chance(self) -> bool:
        """Whether touch and calibration explain it."""
        return self.square <= chi2_quantile(PLAUSIBLE, 3)

    def is_as(self, other: "Miss") -> bool:
        """Whether two touches miss alike: what moved as a whole."""
        apart = self.off - other.off
        covariance = self.covariance + other.covariance
        square = float(apart @ np.linalg.solve(covariance, apart))
        return square <= chi2_quantile(PLAUSIBLE, 3)


@dataclass(frozen=True, slots=True, eq=False)
class InUse:
    """What a calibration in use says of the touches of a session.

    missed: by index of a touch how far the tip is from each target, as `misses` tells; wrists: (3, 3), as its own
    targets are worked on.
    """

    missed: Callable[[int], Mapping[str, Miss]]
    wrists: Sequence[Array] = ()


NONE_IN_USE = InUse(lambda _: {})


def misses(
    calibration: Calibration, touch: Touch, place: CameraPlace, facts: CellFacts
) -> Mapping[str, Miss]:
    """By name of each target that the calibration can serve with the wrist of the touch, in this picture.

    place: where the camera may stand in it; facts: of the session, for the arm. None where tag B was not
    seen, the calibration contradicts the picture, or does not know the tip at this orientation.
    """
    seen = touch.observation
    if seen is None or seen.tag_b is None:
        return {}
    found = {}
    for name in calibration.taught:
        try:
            found[name] = _miss(calibration, name, seen.tag_b, touch, place, facts)
        except (CalibrationError, Contradiction, InputError, TagNotSeen):
            continue  # of this target nothing can be said; serving tells why
    return found


def _miss(
    calibration: Calibration,
    name: str,
    tag_b: TagObservation,
    touch: Touch,
    place: CameraPlace,
    facts: CellFacts,
) -> Miss:
    W = touch.base_from_wrist
    expected = expected_coordinate(calibration, name, tag_b, Policy.REQUESTED, W.rotation, place)
    work = W.rotation @ calibration.facts.tool.work_from_touch_mm
    off = W.translation - expected.base_from_wrist.translation - work
    covariance = expected.position_covariance + _touch_covariance(touch, facts)
    return Miss(off, covariance, float(off @ np.linalg.solve(covariance, off)))


def _touch_covariance(touch: Touch, facts: CellFacts) -> Array:
    """(3, 3) in the base of touch and arm; what was not measured is wide open."""
    axis = touch.base_from_wrist.rotation @ facts.tool.axis_in_wrist
    along = np.outer(axis, axis)
    lateral, axial = (
        min(sigma, _OPEN_MM) ** 2 for sigma in (touch.lateral_sigma_mm, touch.axial_sigma_mm)
    )
    arm = facts.flange_sigma_mm**2
    return np.asarray(lateral * (np.eye(3) - along) + axial * along + arm * np.eye(3))
