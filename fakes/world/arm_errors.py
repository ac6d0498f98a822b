"""How an arm differs from its report: a smooth field over the workspace, and a draw per move."""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose, exp_rotation

RAD_PER_MM = 0.75e-3  # rotation that comes with a translation: 0.15 mrad at 0.2 mm
_WAVES = 6  # few long waves, as the geometry of a real arm makes them
_FEATURES = 64  # of the random Fourier field


def deviated(pose: Pose, deviation: Array) -> Pose:
    """Shift `pose` by deviation[:3], mm, and turn it about its own origin by deviation[3:], base axes."""
    return Pose(
        exp_rotation(deviation[3:]) @ pose.rotation,
        pose.translation + deviation[:3],
    )


@dataclass(frozen=True, slots=True, eq=False)
class ErrorField:
    """A smooth deviation of the arm: a sum of sinusoids over the position of the flange.

    waves: (n, 3) rad/mm; phases: (n, 6); weights: (n, 6) mm and rad per wave.
    """

    waves: Array
    phases: Array
    weights: Array

    @classmethod
    def random(cls, seed: int, peak_mm: float, workspace_mm: Array) -> "ErrorField":
        """Draw waves of 400 to 1200 mm.

        The largest translation of the field over `workspace_mm` (2, 3) is `peak_mm`.
        """
        rng = np.random.default_rng((seed, 1))
        directions = rng.standard_normal((_WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        waves = directions * (2 * np.pi / rng.uniform(400, 1200, (_WAVES, 1)))
        weights = rng.standard_normal((_WAVES, 6)) * ([1.0] * 3 + [RAD_PER_MM] * 3)
        unscaled = cls(waves, rng.uniform(0, 2 * np.pi, (_WAVES, 6)), weights)
        box = np.linspace(workspace_mm[0], workspace_mm[1], 9).T
        grid = np.stack(np.meshgrid(*box), -1).reshape(-1, 3)
        peak = max(float(np.linalg.norm(unscaled.tangent(p)[:3])) for p in grid)
        return cls(waves, unscaled.phases, weights * (peak_mm / peak))

    @classmethod
    def fourier(
        cls, rng: np.random.Generator, axes: Array, sigma_mm: float, length_mm: float
    ) -> "ErrorField":
        """Draw random Fourier features of a squared-exponential field (Rahimi and Recht 2007).

        axes: (6,) sigma of each axis, mm and rad, where `sigma_mm` is 1. length_mm: over which the
        field changes.
        """
        weights = rng.normal(size=(_FEATURES, 6)) * axes * sigma_mm * np.sqrt(2 / _FEATURES)
        phases = rng.uniform(0, 2 * np.pi, (_FEATURES, 6))
        return cls(rng.normal(size=(_FEATURES, 3)) / length_mm, phases, weights)

    def tangent(self, flange_in_base: Array) -> Array:
        """Deviation (6,) at a flange position (3,): (mm, rad) in the base frame."""
        return np.asarray(
            (self.weights * np.sin((self.waves @ flange_in_base)[:, None] + self.phases)).sum(0)
        )


@dataclass(frozen=True, slots=True)
class ArmErrors:
    """How the arm differs from its report: a new draw for every move, and a smooth field.

    sigma_mm, field_mm: per axis; turns are rad_per_mm times as large; length_mm: over which the
    field changes (squared-exponential correlation).
    """

    sigma_mm: float = 0.0
    field_mm: float = 0.0
    length_mm: float = 200.0  # a guess: a fraction of the reach, as errors of links and joints
    rad_per_mm: float = RAD_PER_MM

    def deviation(self, rng: np.random.Generator) -> Array:
        """Draw the deviation (6,) of one move: (mm, rad) in the base frame."""
        return np.asarray(rng.normal(size=6) * self._axes() * self.sigma_mm)

    def field(self, rng: np.random.Generator) -> ErrorField:
        """Draw the field of one arm."""
        return ErrorField.fourier(rng, self._axes(), self.field_mm, self.length_mm)

    def _axes(self) -> Array:
        """Sigma (6,) of each axis for 1 mm."""
        return np.array([1.0] * 3 + [self.rad_per_mm] * 3)


EXACT_ARM = ArmErrors()
