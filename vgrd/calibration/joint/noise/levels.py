"""How large each kind of noise of a session is, by its own samples; what a file states is a prior."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from vgrd.calibration.joint.fit import determined_columns
from vgrd.calibration.joint.noise.kinds import (
    ACROSS,
    ALONG,
    CAD,
    CENTER,
    FIELD,
    HOLES,
    NOISE_OF_TAG_A,
    NOISE_OF_TAG_B,
    POINT,
    STOP,
)
from vgrd.calibration.joint.problem import EvidenceKind, JointData, Tags, target_of
from vgrd.calibration.joint.rows import arm_jacobian, as_refined, linearize
from vgrd.calibration.joint.state import JointState, StepLayout, taught_place
from vgrd.calibration.levels import (
    STATED_FACTOR,
    Level,
    Levels,
    Part,
    find_levels_of,
    wider_by_freedom,
)
from vgrd.calibration.touches import TouchSet, touched_orientation
from vgrd.geometry import Array

_CENTER_FACTOR = (
    4.0  # as `STATED_FACTOR`, of what people say of a centre that they hardly ever measure
)
_SMOOTH = 1e-4  # of the largest variance of a shape of the field: a hundredth of its size


class Noise:
    """The noise of samples in parts, around a state; data: at the levels that are stated, as gathered."""

    def __init__(self, raw: JointData, layout: StepLayout, state: JointState) -> None:
        self._data, self._layout, self._state = as_refined(state, raw, layout), layout, state
        self._residuals, jacobian = linearize(state, self._data, layout)
        self.parts, self._known = self._split()
        self._basis = determined_columns(
            np.linalg.solve(np.linalg.cholesky(self._covariance()), jacobian), layout
        )
        self._jacobian = jacobian @ self._basis

    def find(self, start: Array | None = None) -> Levels:
        """Most likely levels, in the order of `parts`."""
        factors = np.array(
            [_CENTER_FACTOR if name == CENTER else STATED_FACTOR for name in self.parts]
        )
        levels = find_levels_of(
            self._residuals,
            self._jacobian,
            list(self.parts.values()),
            self._known,
            prior_factors=factors,
            start=start,
        )
        # One centre that happens to be near CAD does not make CAD better than it is said to be.
        least = np.where([name == CENTER for name in self.parts], 0.0, -np.inf)
        return replace(levels, log_variances=np.maximum(levels.log_variances, least))

    def widening(self, levels: Levels) -> float:
        """Factor of a sigma for levels that are not known exactly, the largest of all touched targets."""
        sizes = np.exp(levels.log_variances)
        V = self._covariance(sizes)
        by = np.linalg.solve(V, self._jacobian)
        gain = np.linalg.solve(self._jacobian.T @ by, by.T)
        widest = 1.0
        for J in self._flanges():
            K = J @ self._basis @ gain
            # One centre tells nothing of how far centres are off: what is stated of it is believed here.
            squares = [
                float(np.sum(part.of(K) ** 2)) if name != CENTER else 0.0
                for name, part in self.parts.items()
            ]
            freedom = levels.freedom_of(sizes * squares, float(np.trace(K @ V @ K.T)))
            widest = max(widest, wider_by_freedom(freedom))
        return widest

    def named(self, levels: Levels) -> tuple[Level, ...]:
        """The levels in their units."""
        stated = _stated(self._data)
        return levels.named([(name, *stated[name]) for name in self.parts])

    def _covariance(self, sizes: Array | None = None) -> Array:
        """(r, r) of all rows; sizes (k,): variances over the stated ones."""
        size = len(self._residuals)
        factors = np.ones(len(self.parts)) if sizes is None else sizes
        total = self._known.copy()
        for factor, part in zip(factors, self.parts.values(), strict=True):
            total += factor * part.covariance(size)
        return total

    def _flanges(self) -> Iterator[Array]:
        """Derivatives (3, n) of where the flange must be for each touched target."""
        recording, state = self._data.recording, self._state
        for name in sorted({touch.target for touch in recording.touches}):
            J = taught_place(
                target_of(recording.facts, name),
                state.base_from_object,
                state.bare_in_base,
                state.offsets_in_object,
                self._layout,
            )[1]
            J[:, StepLayout.TCP] = -touched_orientation(recording.touches, name)
            yield J

    def _split(self) -> tuple[dict[str, Part], Array]:
        """Kinds that have a level, by name, and (r, r) covariance of the rest: priors and rounding."""
        parts, size = _of_sensors(self._data, len(self._residuals)), len(self._residuals)
        known = np.asarray(np.eye(size), dtype=np.float64)
        for part in parts.values():
            known -= part.covariance(size)
        arm, at = self._data.arm, self._data.flange_at
        if not arm.is_exact:
            G, k = arm_jacobian(self._state, self._data), self._data.arm_rows
            known[:k, :k] += (G * np.tile(arm.rounding() ** 2, len(at))) @ G.T
            parts |= _of_arm(self._data, G)
        return parts, known


def _of_sensors(data: JointData, size: int) -> dict[str, Part]:
    rows = {kind: np.arange(size)[data.rows_of(kind)] for kind in data.counts}
    of_b = np.concatenate([rows[EvidenceKind.REFERENCE], rows[EvidenceKind.SPINS]])
    across, along = _by_tool(data.touches)
    parts = {
        NOISE_OF_TAG_A: Part(rows[EvidenceKind.HAND_EYE]),
        NOISE_OF_TAG_B: Part(of_b),
        ACROSS: Part(rows[EvidenceKind.TOUCHES], across),
        ALONG: Part(rows[EvidenceKind.TOUCHES], along),
        POINT: Part(rows[EvidenceKind.POINTS], np.hstack(_by_tool(data.points))),
        HOLES: Part(rows[EvidenceKind.HOLES]),
        CAD: Part(rows[EvidenceKind.CAD]),
        CENTER: Part(rows[EvidenceKind.TURNTABLE][: 2 * (data.center is not None)]),
    }
    return {name: part for name, part in parts.items() if part.size}


def _by_tool(touches: TouchSet) -> tuple[Array, Array]:
    """Factors (3 m, q) of touches of variance 1 across and along the tool, as far as they measured it."""
    axis = touches.axis_in_wrist
    across = np.linalg.svd(axis[None])[2][1:].T
    lateral, axial = (
        np.eye(len(touches))[:, np.isfinite(sigma)]
        for sigma in (touches.lateral_sigma_mm, touches.axial_sigma_mm)
    )
    return np.asarray(np.kron(lateral, across)), np.asarray(np.kron(axial, axis[:, None]))


def _of_arm(data: JointData, G: Array) -> dict[str, Part]:
    """G: derivative (k, 6 s) of the rows that feel the arm by its deviations."""
    arm, at, rows = data.arm, data.flange_at, np.arange(len(G))
    scales, parts = np.diag(arm.scales()), {}
    if arm.sigma_mm > 0:
        # Rows feel the arm where it stood, and nowhere else.
        own = G.reshape(len(G), len(at), 6) * (arm.sigma_mm * arm.scales())
        parts[STOP] = Part(rows, csr_array(own.reshape(len(G), -1)))
    if arm.field_mm > 0:
        variances, shapes = np.linalg.eigh(arm.field(at, at))
        smooth = variances > _SMOOTH * variances[-1]
        L = shapes[:, smooth] * np.sqrt(variances[smooth])
        parts[FIELD] = Part(rows, G @ np.kron(L, scales))
    return parts


def _stated(data: JointData) -> Mapping[str, tuple[str, float]]:
    """Unit and sigma of each kind; of those that differ from sample to sample the median."""
    return {
        NOISE_OF_TAG_A: ("x", 1.0),
        NOISE_OF_TAG_B: ("x", 1.0),
        ACROSS: ("mm", _middle(data.touches.lateral_sigma_mm)),
        ALONG: ("mm", _middle(data.touches.axial_sigma_mm)),
        POINT: ("mm", _middle(data.points.lateral_sigma_mm)),
        HOLES: ("px", _middle(data.holes.sigma_px)),
        CAD: ("mm", data.cad_sigma_mm),
        CENTER: ("mm", data.turntable.center_sigma_mm),
        STOP: ("mm", data.arm.sigma_mm),
        FIELD: ("mm", data.arm.field_mm),
    }


def _middle(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else 1.0


def at_levels(data: JointData, scales: Mapping[str, float]) -> JointData:
    """The evidence with sigmas multiplied, by kind of noise."""

    def scale(name: str) -> float:
        return scales.get(name, 1.0)

    def seen(tags: Tags, name: str) -> Tags:
        return replace(tags, sqrt_informations=tags.sqrt_informations / scale(name))

    holes, arm, turntable = data.holes, data.arm, data.turntable
    center_sigma_mm = turntable.center_sigma_mm * scale(CENTER)
    return replace(
        data,
        looks=replace(data.looks, tags=seen(data.looks.tags, NOISE_OF_TAG_A)),
        reference=seen(data.reference, NOISE_OF_TAG_B),
        spins=seen(data.spins, NOISE_OF_TAG_B),
        touches=data.touches.scaled(scale(ACROSS), scale(ALONG)),
        points=data.points.scaled(scale(POINT), scale(POINT)),
        holes=replace(holes, sigma_px=holes.sigma_px * scale(HOLES)),
        cad_sigma_mm=data.cad_sigma_mm * scale(CAD),
        turntable=replace(turntable, center_sigma_mm=center_sigma_mm),
        arm=replace(
            arm, sigma_mm=arm.sigma_mm * scale(STOP), field_mm=arm.field_mm * scale(FIELD)
        ),
    )
