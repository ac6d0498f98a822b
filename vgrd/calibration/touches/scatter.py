"""How well an operator repeats a touch: sigma across and along the tool, with its uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.touches.equations import TouchSet
from vgrd.errors import InputError, TooFewObservations
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile

_SAME_WRIST = 0.02  # norm of a difference of rotations: 0.8 degrees, 1.7 mm at a tool of 120 mm


@dataclass(frozen=True, slots=True)
class Sigma:
    """value_mm: standard deviation of one direction; low_mm, high_mm: its 95 % confidence interval."""

    value_mm: float
    low_mm: float
    high_mm: float
    degrees_of_freedom: int


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Scatter of repeated touches across (per direction) and along the tool."""

    lateral: Sigma
    axial: Sigma


def repeatability(
    touches: TouchSet,
    targets: Sequence[str],
    tcp_in_wrist: Array,
    *,
    tcp_is_fitted: bool = False,
) -> Repeatability:
    """Pooled scatter of the touches (m) that share the name of their target around its mean.

    tcp_in_wrist: (3,) mm; with the same wrist in all touches of a target it cancels. tcp_is_fitted:
    to these touches, so that where the wrists differ its three numbers hide one touch's scatter.
    Raises InputError on a wrong number of names, TooFewObservations when too few were repeated.
    """
    if len(targets) != len(touches):
        raise InputError(f"{len(touches)} touches need as many targets, got {len(targets)}")
    tips = touches.rotations @ tcp_in_wrist + touches.translations
    residuals, degrees_of_freedom = np.zeros_like(tips), 0
    turns = np.zeros(len(touches))
    for name in dict.fromkeys(targets):
        group = np.array([target == name for target in targets])
        residuals[group] = tips[group] - tips[group].mean(axis=0)
        turns[group] = np.linalg.norm(
            touches.rotations[group] - touches.rotations[group].mean(axis=0), axis=(1, 2)
        )
        degrees_of_freedom += int(group.sum()) - 1
    if tcp_is_fitted and turns.max() > _SAME_WRIST:
        degrees_of_freedom -= 1
    if degrees_of_freedom < 1:
        raise TooFewObservations(
            "no target was touched twice (with the wrist turned in between: three times): touch at "
            "least one of them again, better each of them"
        )
    along = np.einsum("mi,mij,j->m", residuals, touches.rotations, touches.axis_in_wrist)
    across = float(np.sum(residuals**2) - np.sum(along**2))
    return Repeatability(
        _sigma(across, 2 * degrees_of_freedom), _sigma(float(np.sum(along**2)), degrees_of_freedom)
    )


def _sigma(squares: float, degrees_of_freedom: int) -> Sigma:
    low, high = (chi2_quantile(q, degrees_of_freedom) for q in (0.975, 0.025))
    value, least, most = (float(np.sqrt(squares / f)) for f in (degrees_of_freedom, low, high))
    return Sigma(value, least, most, degrees_of_freedom)
