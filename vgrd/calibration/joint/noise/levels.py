"""How large each kind of noise of a session is, by its own samples; what a file states is a prior."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from vgrd.calibration.joint.fit import arm_noise, determined_half, whiten_arm
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
from vgrd.calibration.joint.noise.likelihood import Part, Restricted
from vgrd.calibration.joint.problem import EvidenceKind, Indices, JointData, Tags, target_of
from vgrd.calibration.joint.rows import ArmRows, arm_rows, as_refined, linearize
from vgrd.calibration.joint.state import JointState, StepLayout, taught_place
from vgrd.calibration.levels import (
    STATED_FACTOR,
    Level,
    Levels,
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
        residuals, jacobian = linearize(state, self._data, layout)
        arm = arm_rows(state, self._data)
        whitened = whiten_arm(arm_noise(state, self._data), jacobian)
        self._basis = determined_half(whitened, layout)
        self.parts, known = _split(self._data, arm, len(residuals))
        others = len(self._data.flange_at) + np.arange(len(residuals) - len(arm.stations))
        self._likelihood = Restricted(
            residuals,
            jacobian @ self._basis,
            np.concatenate([arm.stations, others]),
            list(self.parts.values()),
            known,
        )

    def find(self, start: Array | None = None) -> Levels:
        """Most likely levels, in the order of `parts`."""
        factors = np.array(
            [_CENTER_FACTOR if name == CENTER else STATED_FACTOR for name in self.parts]
        )
        levels = self._likelihood.find(factors, start)
        # One centre that happens to be near CAD does not make CAD better than it is said to be.
        least = np.where([name == CENTER for name in self.parts], 0.0, -np.inf)
        return replace(levels, log_variances=np.maximum(levels.log_variances, least))

    def widening(self, levels: Levels) -> float:
        """Factor of a sigma for levels that are not known exactly, the largest of all touched targets."""
        J = np.array(list(self._flanges())) @ self._basis
        parts, totals = self._likelihood.variances(J, np.exp(levels.log_variances))
        # One centre tells nothing of how far centres are off: what is stated of it is believed here.
        parts = parts * np.array([name != CENTER for name in self.parts])
        freedoms = [levels.freedom_of(*one) for one in zip(parts, totals, strict=True)]
        return max([1.0, *map(wider_by_freedom, freedoms)])

    def named(self, levels: Levels) -> tuple[Level, ...]:
        """The levels in their units."""
        stated = _stated(self._data)
        return levels.named([(name, *stated[name]) for name in self.parts])

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


def _split(
    data: JointData, arm: ArmRows, size: int
) -> tuple[dict[str, Part], list[tuple[float, Part]]]:
    """Kinds that have a level, by name, and the rest of all rows, priors and rounding, with its signs."""
    parts = _of_sensors(data, size)
    known = [(1.0, Part.independent(np.arange(size)))]
    known += [(-1.0, part) for part in parts.values()]
    if not data.arm.is_exact:
        known.append((1.0, _at_stations(arm, data.arm.rounding())))
        parts |= _of_arm(data, arm)
    return parts, known


def _of_sensors(data: JointData, size: int) -> dict[str, Part]:
    rows = {kind: np.arange(size)[data.rows_of(kind)] for kind in data.counts}
    of_b = np.concatenate([rows[EvidenceKind.REFERENCE], rows[EvidenceKind.SPINS]])
    across, along = _by_tool(rows[EvidenceKind.TOUCHES], data.touches)
    points = _by_tool(rows[EvidenceKind.POINTS], data.points)
    parts = {
        NOISE_OF_TAG_A: Part.independent(rows[EvidenceKind.HAND_EYE]),
        NOISE_OF_TAG_B: Part.independent(of_b),
        ACROSS: across,
        ALONG: along,
        POINT: replace(points[0], factor=np.hstack([part.factor for part in points])),
        HOLES: Part.independent(rows[EvidenceKind.HOLES]),
        CAD: Part.independent(rows[EvidenceKind.CAD]),
        CENTER: Part.independent(rows[EvidenceKind.TURNTABLE][: 2 * (data.center is not None)]),
    }
    return {name: part for name, part in parts.items() if part.factor.any()}


def _by_tool(rows: Indices, touches: TouchSet) -> tuple[Part, Part]:
    """Touches of variance 1 across and along the tool, as far as they measured it."""
    axis, touch = touches.axis_in_wrist, np.arange(len(touches))
    across = np.linalg.svd(axis[None])[2][1:].T
    lateral, axial = (
        np.isfinite(sigma)[:, None, None]
        for sigma in (touches.lateral_sigma_mm, touches.axial_sigma_mm)
    )
    return (
        Part(rows, (lateral * across).reshape(-1, 2), np.repeat(touch, 3)),
        Part(rows, (axial * axis[:, None]).reshape(-1, 1), np.repeat(touch, 3)),
    )


def _of_arm(data: JointData, rows: ArmRows) -> dict[str, Part]:
    arm, at, parts = data.arm, data.flange_at, {}
    if arm.sigma_mm > 0:
        parts[STOP] = _at_stations(rows, arm.sigma_mm * arm.scales())
    if arm.field_mm > 0:
        variances, shapes = np.linalg.eigh(arm.field(at, at))
        smooth = variances > _SMOOTH * variances[-1]
        L = shapes[:, smooth] * np.sqrt(variances[smooth])
        scaled = rows.by_deviation * arm.scales()
        factor = L[rows.stations][:, :, None] * scaled[:, None, :]
        parts[FIELD] = Part(np.arange(len(scaled)), factor.reshape(len(scaled), -1), None)
    return parts


def _at_stations(rows: ArmRows, sigmas: Array) -> Part:
    """Deviations (6,) of the arm that it draws wherever it stands."""
    return Part(np.arange(len(rows.stations)), rows.by_deviation * sigmas, rows.stations)


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
