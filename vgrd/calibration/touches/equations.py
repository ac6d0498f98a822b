"""Touches as equations: what all methods that use the tool's tip share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose

_LEVERAGE_FLOOR = 1e-9  # of a share between 0 and 1: rounding
_ACROSS = 1e-6  # sine to the tool's axis below which a direction is along it


@dataclass(frozen=True, slots=True, eq=False)
class TouchSet:
    """m touches with the same tool: rotations (m, 3, 3) and translations (m, 3) of base_from_wrist.

    axis_in_wrist: (3,) unit vector of the tool; lateral_sigma_mm, axial_sigma_mm: (m,), across and
    along it, infinite where nothing was measured. Raises InputError naming the touch.
    """

    rotations: Array
    translations: Array
    axis_in_wrist: Array
    lateral_sigma_mm: Array
    axial_sigma_mm: Array

    def __post_init__(self) -> None:
        m = len(self.rotations)
        shapes: Mapping[str, tuple[int, ...]] = {
            "rotations": (m, 3, 3),
            "translations": (m, 3),
            "axis_in_wrist": (3,),
            "lateral_sigma_mm": (m,),
            "axial_sigma_mm": (m,),
        }
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or np.isnan(array).any():
                raise InputError(f"{name} of touches needs shape {shape} without NaN")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        sigmas = np.concatenate([self.lateral_sigma_mm, self.axial_sigma_mm])
        if (sigmas <= 0).any():
            raise InputError("a touch needs a sigma above 0 mm")
        if abs(float(np.linalg.norm(self.axis_in_wrist)) - 1) > 1e-6:
            raise InputError("the axis of a tool is a unit vector")

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def is_isotropic(self) -> bool:
        """True when every touch measured equally well along and across the tool."""
        return bool(np.array_equal(self.lateral_sigma_mm, self.axial_sigma_mm))

    def sqrt_informations(self) -> Array:
        """Matrices (m, 3, 3) that turn errors in the wrist frame into errors of unit variance."""
        along = np.outer(self.axis_in_wrist, self.axis_in_wrist)
        across = np.eye(3) - along
        return (
            across / self.lateral_sigma_mm[:, None, None]
            + along / self.axial_sigma_mm[:, None, None]
        )

    def base_sqrt_informations(self) -> Array:
        """The same for errors in the base frame: (m, 3, 3)."""
        return np.asarray(self.sqrt_informations() @ np.swapaxes(self.rotations, 1, 2))

    def measured(self) -> "TouchSet":
        """The same touches, every measured direction with sigma 1 mm: what tells the rank."""
        return TouchSet(
            self.rotations,
            self.translations,
            self.axis_in_wrist,
            np.where(np.isfinite(self.lateral_sigma_mm), 1.0, np.inf),
            np.where(np.isfinite(self.axial_sigma_mm), 1.0, np.inf),
        )

    def weighted(self, weights: Array) -> "TouchSet":
        """The same touches, variances divided by weights (m,); weight 0 leaves a touch out."""
        with np.errstate(divide="ignore"):
            factor = 1 / np.sqrt(weights)
        return TouchSet(
            self.rotations,
            self.translations,
            self.axis_in_wrist,
            self.lateral_sigma_mm * factor,
            self.axial_sigma_mm * factor,
        )

    def scaled(self, lateral: float, axial: float) -> "TouchSet":
        """The same touches, sigmas across and along the tool multiplied."""
        return TouchSet(
            self.rotations,
            self.translations,
            self.axis_in_wrist,
            self.lateral_sigma_mm * lateral,
            self.axial_sigma_mm * axial,
        )

    def subset(self, chosen: NDArray[np.intp]) -> "TouchSet":
        """Those with the given indices."""
        return TouchSet(
            self.rotations[chosen],
            self.translations[chosen],
            self.axis_in_wrist,
            self.lateral_sigma_mm[chosen],
            self.axial_sigma_mm[chosen],
        )

    def sigma_along(self, directions: Array) -> Array:
        """Sigma (m,) of each touch along a direction (m, 3), unit vectors in the base."""
        along = np.einsum("mi,mij,j->m", directions, self.rotations, self.axis_in_wrist) ** 2
        along = np.where(along < _ACROSS, 0.0, np.minimum(along, 1.0))
        with np.errstate(invalid="ignore"):
            axial = np.where(along > 0, along * self.axial_sigma_mm**2, 0.0)
            across = 1 - along
            lateral = np.where(across > _ACROSS, across * self.lateral_sigma_mm**2, 0.0)
        return np.asarray(np.sqrt(axial + lateral))

    def equations(self) -> int:
        """How many directions were measured."""
        finite = 2 * np.isfinite(self.lateral_sigma_mm) + np.isfinite(self.axial_sigma_mm)
        return int(finite.sum())


def touch_set(
    poses: Sequence[Pose],
    axis_in_wrist: Array,
    lateral_sigma_mm: Sequence[float] | Array,
    axial_sigma_mm: Sequence[float] | Array,
) -> TouchSet:
    """Build the arrays from the flange poses of the touches."""
    return TouchSet(
        np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3),
        np.array([pose.translation for pose in poses]).reshape(-1, 3),
        np.asarray(axis_in_wrist),
        np.asarray(lateral_sigma_mm),
        np.asarray(axial_sigma_mm),
    )


def studentized_residuals(residuals: Array, jacobian: Array) -> Array:
    """How many sigmas each touch is off, its own pull on the fit taken out; (m,).

    residuals: (m, k) whitened; jacobian: (k m, n) whitened. The squared deleted residual with its
    degrees of freedom is turned into the equivalent two-sided number of sigmas of one normal value.
    """
    Q, _ = np.linalg.qr(jacobian)
    m, k = residuals.shape
    Q = Q.reshape(m, k, -1)
    values, vectors = np.linalg.eigh(np.eye(k) - Q @ Q.transpose(0, 2, 1))
    parts = np.einsum("mij,mi->mj", vectors, residuals)
    measured = (values > _LEVERAGE_FLOOR) & (parts != 0)
    squares = np.sum(parts**2 / np.where(measured, values, np.inf), axis=1)
    return equivalent_sigmas(squares, measured.sum(axis=1))


def equivalent_sigmas(squares: Array, degrees_of_freedom: Array) -> Array:
    """Normal quantile with the same tail as chi2(freedom) at `squares`; Wilson, Hilferty 1931."""
    divisor = np.maximum(degrees_of_freedom, 1)
    width = 2 / (9 * divisor)
    sigmas = ((squares / divisor) ** (1 / 3) - (1 - width)) / np.sqrt(width)
    return np.where(degrees_of_freedom > 0, np.maximum(sigmas, 0.0), 0.0)
