"""Error budget: which link of the chain the expected coordinate's variance comes from.

The answer's error is linear in every noise there is: of the samples, of the arm at every stand and at
the answer, of the picture now. Its covariance is therefore the sum over independent sources, each what
would be left if all the others were nought.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from vgrd.calibration.acceptance import served_radius
from vgrd.calibration.joint import (
    PRINTED,
    TAG_A,
    TAG_B,
    CameraCorrections,
    EvidenceKind,
    JointFit,
    Prediction,
    PriorSigmas,
    Tags,
    predict,
    solution_of,
    target_of,
    whiten_arm,
    work_orientation,
)
from vgrd.calibration.planning.predicted_error import Job, PredictedError
from vgrd.calibration.planning.reach import known_targets
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.model import UNMOVED, CameraPlace, CellFacts, Policy, TagObservation

_NOTHING = np.zeros((3, 3))


class Source(StrEnum):
    """Links of the chain.

    REPEATABILITY, FIELD, QUANTISATION: the arm, taught and at the answer. HAND_EYE: tag A in all
    pictures. TCP: touches of a fixed point; where none were taught, the TCP's error is among the
    TOUCHES. TAG_B: in the pictures while touching, in spins, and now. PRINT, INTRINSICS, TIME: what
    all pictures share, or what moved since. CAMERA: it may stand elsewhere since, as far as tag A does not
    tell. EXCESS: residuals beyond all stated sigmas. UNDETERMINED: what the samples leave open.
    """

    REPEATABILITY = "robot repeatability"
    FIELD = "robot error field"
    QUANTISATION = "pose quantisation"
    HAND_EYE = "hand-eye (tag A)"
    TCP = "TCP (fixed point)"
    TOUCHES = "touches"
    TAG_B = "tag noise (tag B)"
    HOLES = "holes"
    TURNTABLE = "turntable in CAD"
    CAD = "targets in CAD"
    PRINT = "print tolerance"
    INTRINSICS = "intrinsics"
    CAMERA = "camera moved since (tag A)"
    TIME = "time"
    EXCESS = "beyond the stated noise"
    UNDETERMINED = "left undetermined"


_SAMPLES: Mapping[EvidenceKind, Source] = {
    EvidenceKind.HAND_EYE: Source.HAND_EYE,
    EvidenceKind.TOUCHES: Source.TOUCHES,
    EvidenceKind.POINTS: Source.TCP,
    EvidenceKind.REFERENCE: Source.TAG_B,
    EvidenceKind.SPINS: Source.TAG_B,
    EvidenceKind.HOLES: Source.HOLES,
    EvidenceKind.TURNTABLE: Source.TURNTABLE,
    EvidenceKind.CAD: Source.CAD,
}


@dataclass(frozen=True, slots=True)
class Systematic:
    """Errors that all pictures share, and those of time.

    corrections: sigmas of print and intrinsics; what `JointFit` refined counts as it was refined.
    drift_mm: sigma per axis of what moved since the calibration, or while the answer was used.
    """

    corrections: PriorSigmas = field(default_factory=PriorSigmas)
    drift_mm: float = 0.0

    @classmethod
    def of(
        cls,
        facts: CellFacts,
        *,
        print_share: float = 5e-4,  # a guess: 0.0125 mm of a tag of 25 mm
        focal_share: float = 3e-4,  # a guess: 2 px of 6486 (the fake cell's camera)
        center_px: float = 0.5,  # a guess: an intrinsic calibration leaves about a pixel, 2 sigma
        drift_mm: float = 0.02,  # a guess: steel of 0.8 m grows so much by 2 K
    ) -> "Systematic":
        """Of a cell, by shares of the tags' sizes and of the focal length."""
        corrections = PriorSigmas(
            tag_a_mm=print_share * (facts.tag_a or facts.tag_b).size_mm,
            tag_b_mm=print_share * facts.tag_b.size_mm,
            focal_px=focal_share * float(facts.camera_matrix[0, 0]),
            center_px=center_px,
        )
        return cls(corrections, drift_mm)


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Shares (t, l) of the links in the variance of every target, rows summing to 1.

    u95_mm: (t,) 95 % radii, systematic errors included. irrelevant: directions that the samples
    leave open and that no answer depends on, in words.
    """

    targets: tuple[str, ...]
    links: tuple[Source, ...]
    shares: Array
    u95_mm: Array
    irrelevant: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, str | float]]:
        """The table: one dictionary per target with its name, u95_mm and every share."""
        shares = [
            {str(link): float(value) for link, value in zip(self.links, row, strict=True)}
            for row in self.shares
        ]
        return [
            {"target": name, "u95_mm": float(radius), **row}
            for name, radius, row in zip(self.targets, self.u95_mm, shares, strict=True)
        ]

    @property
    def means(self) -> dict[str, float]:
        """Share of every link, mean of the targets."""
        return {
            str(link): float(share)
            for link, share in zip(self.links, self.shares.mean(axis=0), strict=True)
        }

    def to_json(self) -> dict[str, object]:
        """As `vgrd budget --json` writes it."""
        return {
            "links": [str(link) for link in self.links],
            "means": self.means,
            "targets": self.rows(),
            "irrelevant": list(self.irrelevant),
        }


def error_budget(
    result: JointFit,
    now: TagObservation,
    policy: Policy = Policy.FIXED,
    base_from_work: Array | None = None,
    systematic: Systematic | None = None,
    targets: Sequence[str] | None = None,
    place: CameraPlace = UNMOVED,
) -> Budget:
    """Where the variance of every target's expected coordinate comes from, for a picture.

    place: where the camera may stand in it, as answers are served. Shares are of the trace of the
    position's covariance. Raises what `expected_by_joint` raises.
    """
    names = tuple(targets or known_targets(result))
    if not names:
        raise InputError("an error budget needs at least one target")
    chain = _Chain(result, now, systematic or Systematic())
    solution = solution_of(result)
    works = [work_orientation(result.recording, n, policy, base_from_work) for n in names]
    predictions = [
        predict(result, solution, name, now, policy, work)
        for name, work in zip(names, works, strict=True)
    ]
    per_target = [chain.parts(prediction) for prediction in predictions]
    if not place.is_exact:
        facts = result.recording.facts
        for parts, still, name, work in zip(per_target, predictions, names, works, strict=True):
            moved = solution.predict(facts, target_of(facts, name), now, policy, work, place)
            parts[Source.CAMERA] = _added(
                moved.covariance(solution.covariance, now.covariance),
                still.covariance(result.covariance, now.covariance),
            )
    links = tuple(link for link in Source if link in per_target[0])
    traces = np.array([[np.trace(parts[link]) for link in links] for parts in per_target])
    covariances = [np.sum(list(parts.values()), axis=0) for parts in per_target]
    radii = np.array([served_radius(covariance, place) for covariance in covariances])
    asked = () if base_from_work is None else (base_from_work,)
    job = Job(policy, asked, angles_rad=(0.0,), targets=names)
    undetermined = PredictedError(result, job).undetermined()
    irrelevant = tuple(direction.what for direction in undetermined if not direction.matters)
    return Budget(names, links, traces / traces.sum(axis=1, keepdims=True), radii, irrelevant)


def _added(moved: Array, still: Array) -> Array:
    """Covariance (3, 3) beyond that of a camera that stands; what tag A tells beside is left out."""
    values, vectors = np.linalg.eigh(moved - still)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


class _Chain:
    """Covariances (3, 3) of the links for one picture, target by target."""

    def __init__(self, result: JointFit, now: TagObservation, systematic: Systematic) -> None:
        self._result, self._now, self._systematic = result, now, systematic

    def parts(self, prediction: Prediction) -> dict[Source, Array]:
        """Covariance (3, 3) that every link causes."""
        result, scale = self._result, self._result.variance_scale
        gain = self._gain(prediction)
        unknown = prediction.J_unknowns @ result.undetermined
        parts = self._of_samples(gain)
        picture_part = prediction.J_picture @ self._now.covariance @ prediction.J_picture.T
        parts[Source.TAG_B] = parts.get(Source.TAG_B, _NOTHING) + picture_part
        excess = (1 - 1 / scale) * result.covariance
        parts[Source.EXCESS] = prediction.J_unknowns @ excess @ prediction.J_unknowns.T
        parts[Source.UNDETERMINED] = unknown @ unknown.T
        parts.update(self._of_arm(prediction, gain))
        for source, part in self._of_pictures(prediction, gain).items():
            parts[source] = parts.get(source, _NOTHING) + part
        return parts

    def _of_samples(self, gain: Array) -> dict[Source, Array]:
        data = self._result.data
        parts: dict[Source, Array] = {}
        for link, source in _SAMPLES.items():
            if data.counts[link]:
                K = gain[:, data.rows_of(link)]
                parts[source] = parts.get(source, _NOTHING) + K @ K.T
        first = data.rows_of(EvidenceKind.REFINED).start
        for i, name in enumerate(data.corrections.sigmas):
            source = _source(name)
            K = gain[:, first + i : first + i + 1]
            parts[source] = parts.get(source, _NOTHING) + K @ K.T
        return parts

    def _gain(self, prediction: Prediction) -> Array:
        """How the answer moves, (3, r), with the noise of every row in sigmas of its sensor.

        By the unknowns, and where the arm has a field by the correction that the residuals suggest.
        """
        result = self._result
        covariance = result.covariance / result.variance_scale
        gain = np.asarray(-prediction.J_unknowns @ covariance @ result.jacobian.T)
        k = len(result.arm_factor)
        if not k:
            return gain
        gain[:, :k] -= prediction.J_arm @ self._correction(prediction)
        first = solve_triangular(result.arm_factor, gain[:, :k].T, lower=True, trans="T")
        return np.hstack([first.T, gain[:, k:]])

    def _correction(self, prediction: Prediction) -> Array:
        """How the predicted deviation (6,) at the answer moves with whitened residuals (6, k)."""
        result, arm = self._result, self._result.data.arm
        cross_covariance = arm.field(
            prediction.base_from_wrist.translation[None], result.data.flange_at
        )
        shared = (
            np.kron(cross_covariance, np.diag(arm.scales() ** 2)) @ result.deviation_jacobian.T
        )
        return np.asarray(whiten_arm(result.arm_factor, shared.T).T)

    def _of_arm(self, prediction: Prediction, gain: Array) -> dict[Source, Array]:
        """A new draw at every stand and at the answer, rounding, and the smooth field."""
        result, arm = self._result, self._result.data.arm
        k = len(result.arm_factor)
        if not k:
            return {}
        stations = result.data.flange_at
        J = np.concatenate(
            [
                (-gain[:, :k] @ result.deviation_jacobian)
                .reshape(3, len(stations), 6)
                .transpose(1, 0, 2),
                -prediction.J_arm[None],
            ]
        )
        places = np.vstack([stations, prediction.base_from_wrist.translation])
        squares = arm.scales() ** 2
        drawn = np.einsum("sik,k,sjk->ij", J, arm.sigma_mm**2 * squares, J)
        rounded = np.einsum("sik,k,sjk->ij", J[:-1], arm.rounding() ** 2, J[:-1])
        shared = np.einsum(
            "sik,st,k,tjk->ij", J, arm.field(places, places), squares, J, optimize=True
        )
        parts = {Source.REPEATABILITY: drawn, Source.FIELD: shared, Source.QUANTISATION: rounded}
        return {source: part for source, part in parts.items() if np.trace(part) > 0}

    def _of_pictures(self, prediction: Prediction, gain: Array) -> dict[Source, Array]:
        """What all pictures share, as far as it was not refined, and time."""
        data, systematic, corrections = self._result.data, self._systematic, self._corrections
        parts: dict[Source, Array] = {}
        if corrections.count:
            J = self._by_pictures(prediction, gain)
            for i, name in enumerate(corrections.sigmas):
                if name not in data.corrections.sigmas:
                    source, K = _source(name), J[:, i : i + 1]
                    parts[source] = parts.get(source, _NOTHING) + K @ K.T
        if systematic.drift_mm > 0:
            parts[Source.TIME] = systematic.drift_mm**2 * np.eye(3)
        return parts

    def _by_pictures(self, prediction: Prediction, gain: Array) -> Array:
        """How the answer moves, (3, e), when all tags are seen with sizes or intrinsics off."""
        by_now, by_link = self._tangents
        total = prediction.J_picture @ by_now
        for link, rows in by_link:
            total = total - gain[:, self._result.data.rows_of(link)] @ rows
        return np.asarray(total)

    @cached_property
    def _corrections(self) -> CameraCorrections:
        return CameraCorrections.of(self._result.recording.facts, self._systematic.corrections)

    @cached_property
    def _tangents(self) -> tuple[Array, list[tuple[EvidenceKind, Array]]]:
        """By what all pictures share: tangents (6, e) of the picture now, rows (r, e) of every link."""
        data, corrections = self._result.data, self._corrections
        values = np.zeros(corrections.count)
        now = Tags(
            self._now.camera_from_tag.rotation[None],
            self._now.camera_from_tag.translation[None],
            np.eye(6)[None],
        )
        by_link = []
        for link, tags, tag in (
            (EvidenceKind.HAND_EYE, data.looks.tags, TAG_A),
            (EvidenceKind.REFERENCE, data.reference, TAG_B),
            (EvidenceKind.SPINS, data.spins, TAG_B),
        ):
            rows = tags.sqrt_informations @ _refined_tangents(tags, corrections, tag, values)
            by_link.append((link, rows.reshape(-1, corrections.count)))
        return _refined_tangents(now, corrections, TAG_B, values)[0], by_link


def _refined_tangents(
    tags: Tags, corrections: CameraCorrections, tag: str, values: Array
) -> Array:
    """Tangents (n, 6, e) by which tags are seen elsewhere, per sigma of what is off."""
    return corrections.tangents_as_seen(tags.rotations, tags.translations, tag, values)


def _source(refined: str) -> Source:
    return Source.PRINT if refined in PRINTED else Source.INTRINSICS
