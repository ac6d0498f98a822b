"""The centre of turning by holes that the camera saw: where CAD's centre is in tag B, turned or not.

Eq. 19 holds for any point of the object whose place is known twice, in tag B and as a position of the
flange. The touches give CAD's centre as the latter; the CAD points of holes give the same point in the
tag, while the turning of tag B gives its axis, on which CAD's centre is supposed to be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.joint import HolePixel, variance_inflation
from vgrd.calibration.touches import Reference, equivalent_sigmas, kabsch
from vgrd.calibration.turntable import RotationCenter
from vgrd.errors import DidNotConverge, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose, exp_rotation, hat
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.coincidence import are_in_line
from vgrd.geometry.covariance import covariance_from, sqrt_information
from vgrd.geometry.least_squares import check_convergence, minimize
from vgrd.judging.thresholds import HOLE_SIGMA, HOLES_LINE
from vgrd.model import Recording

_FEWEST_HOLES = 3  # three points fix a plane figure
_ROUNDS = 2  # what the tag's error does is known at the place only
_MOST_LEFT_OUT = 1 / 3  # of the sightings: where more are bad nobody can say which


@dataclass(frozen=True, slots=True, eq=False)
class HoleCenter:
    """CAD's centre in tag B, (3,) mm, with its covariance (3, 3); used: sightings of holes."""

    center_in_tag: Array
    covariance: Array
    used: int


@dataclass(frozen=True, slots=True, eq=False)
class CombinedCenter:
    """Centre as `HoleCenter`; apart: how far holes and turning are apart across the axis, mm and sigmas."""

    center_in_tag: Array
    covariance: Array
    apart_mm: float
    apart_sigmas: float


def find_hole_center(
    recording: Recording, sightings: Sequence[HolePixel], reference: Reference
) -> HoleCenter:
    """CAD's centre in tag B from holes in pictures of the tag, contradicting sightings left out.

    reference: where the object stood as it was touched. The errors of a picture's tag are common to
    its holes. Raises TooFewObservations below three holes, NotObservable for holes on a line or
    without a centre in CAD, DidNotConverge where holes and CAD contradict each other.
    """
    center = recording.facts.object.center_in_object
    if center is None:
        raise NotObservable(
            "the centre of turning is not in CAD: set [object] center_mm", rank=0, unknowns=3
        )
    evidence = _evidence_of(recording, sightings, reference, np.asarray(center))
    count = len(evidence.pixels)
    fewest = count - int(_MOST_LEFT_OUT * count)
    while True:
        pose, covariance, scores = _fit(evidence)
        worst = int(np.argmax(scores))
        if scores[worst] <= HOLE_SIGMA:
            return HoleCenter(pose.translation, covariance, len(scores))
        if len(scores) <= fewest:
            raise DidNotConverge("the holes in the pictures contradict each other and CAD")
        evidence = evidence.without(worst)


def combine(holes: HoleCenter, spins: RotationCenter, center_sigma_mm: float) -> CombinedCenter:
    """The centre by holes with the axis by turning, across it, each as good as its covariance says.

    center_sigma_mm: how far CAD's centre may be off the axis, per coordinate. Along the axis the
    centre stays that of the holes.
    """
    across = np.linalg.svd(spins.axis_in_tag[None])[2][1:]
    apart = across @ (spins.center_in_tag - holes.center_in_tag)
    S = across @ (holes.covariance + spins.covariance[:3, :3]) @ across.T
    S = S + center_sigma_mm**2 * np.eye(2)
    gain = holes.covariance @ across.T @ np.linalg.inv(S)
    squares = np.array([apart @ np.linalg.solve(S, apart)])
    return CombinedCenter(
        holes.center_in_tag + gain @ apart,
        holes.covariance - gain @ across @ holes.covariance,
        float(np.linalg.norm(apart)),
        float(equivalent_sigmas(squares, np.array([2]))[0]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """m sightings in pictures (m,): offsets (m, 3) of their holes from CAD's centre, pixels (m, 2).

    rotations (m, 3, 3), translations (m, 3): of the tag in the camera, for each sighting;
    covariances: of the tag's pose in each picture, as touched first.
    """

    camera: CameraModel
    offsets: Array
    pixels: Array
    sigmas_px: Array
    pictures: NDArray[np.intp]
    rotations: Array
    translations: Array
    covariances: Sequence[Array]

    def without(self, i: int) -> "_Evidence":
        """All but one."""
        return replace(
            self,
            offsets=np.delete(self.offsets, i, axis=0),
            pixels=np.delete(self.pixels, i, axis=0),
            sigmas_px=np.delete(self.sigmas_px, i),
            pictures=np.delete(self.pictures, i),
            rotations=np.delete(self.rotations, i, axis=0),
            translations=np.delete(self.translations, i, axis=0),
        )

    def places(self, in_tag: Array) -> Array:
        """Points of the tag (m, 3), each in the camera of its picture."""
        return np.asarray(np.einsum("mij,mj->mi", self.rotations, in_tag) + self.translations)

    def covariance(self, places: Array) -> Array:
        """Of all pixels (2 m, 2 m): their own errors, and those of the tag in each picture."""
        J = self.camera.linearize(places)[1]
        J_tag = J @ np.concatenate([np.broadcast_to(np.eye(3), (len(J), 3, 3)), -hat(places)], 2)
        total = np.diag(np.repeat(self.sigmas_px**2, 2))
        for k, tag in enumerate(self.covariances):
            rows = np.repeat(self.pictures == k, 2)
            shift = J_tag.reshape(-1, 6)[rows]
            total[np.ix_(rows, rows)] += shift @ tag @ shift.T
        return total


def _evidence_of(
    recording: Recording, sightings: Sequence[HolePixel], reference: Reference, center: Array
) -> _Evidence:
    facts = recording.facts
    poses, covariances = [reference.camera_from_tag_b], [reference.covariance]
    number: dict[int | None, int] = {None: 0}
    for k, spin in enumerate(recording.spins):
        if spin.tag_b is not None:
            number[k] = len(poses)
            poses.append(spin.tag_b.camera_from_tag)
            covariances.append(spin.tag_b.covariance)
    chosen = [hole for hole in sightings if hole.spin in number]
    pictures = np.array([number[hole.spin] for hole in chosen], dtype=np.intp)
    targets = facts.object.targets
    return _Evidence(
        CameraModel(facts.camera_matrix, facts.distortion, facts.image_size_px),
        np.array([targets[hole.target].cad - center for hole in chosen]).reshape(-1, 3),
        np.array([hole.pixel for hole in chosen]).reshape(-1, 2),
        np.array([hole.sigma_px for hole in chosen]),
        pictures,
        np.array([pose.rotation for pose in poses])[pictures],
        np.array([pose.translation for pose in poses])[pictures],
        covariances,
    )


def _fit(evidence: _Evidence) -> tuple[Pose, Array, Array]:
    """Object about CAD's centre in the tag; covariance (3, 3) of its place; scores (m,) in sigmas."""

    def linearize(pose: Pose) -> tuple[Array, Array]:
        arms = evidence.offsets @ pose.rotation.T
        pixels, J = evidence.camera.linearize(evidence.places(arms + pose.translation))
        J_place = J @ evidence.rotations
        J_pose = np.concatenate([J_place, -J_place @ hat(arms)], axis=2)
        return W @ (pixels - evidence.pixels).ravel(), W @ J_pose.reshape(-1, 6)

    def retract(pose: Pose, step: Array) -> Pose:
        return Pose(exp_rotation(step[3:]) @ pose.rotation, pose.translation + step[:3])

    pose = _start(evidence)
    for _ in range(_ROUNDS):
        C = evidence.covariance(evidence.places(pose @ evidence.offsets))
        W = sqrt_information(C)
        minimum = minimize(linearize, retract, pose)
        check_convergence(minimum.report, "centre by holes")
        pose = minimum.state
    residuals = np.linalg.solve(W, minimum.residuals).reshape(-1, 2)
    covariances = np.array(
        [C[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(residuals))]
    )
    squares = np.einsum(
        "mi,mi->m", residuals, np.linalg.solve(covariances, residuals[..., None])[..., 0]
    )
    scale = variance_inflation(2 * minimum.report.cost, minimum.residuals.size - 6)
    covariance = covariance_from(minimum.jacobian)[:3, :3] * scale
    return pose, covariance, equivalent_sigmas(squares, np.full(len(residuals), 2))


def _start(evidence: _Evidence) -> Pose:
    """The holes taken to be in the plane of the tag."""
    count = len(np.unique(evidence.offsets.round(6), axis=0))
    if count < _FEWEST_HOLES:
        raise TooFewObservations(
            f"a centre by holes needs {_FEWEST_HOLES} holes in the pictures, there are {count}"
        )
    if are_in_line(evidence.offsets, HOLES_LINE):
        raise NotObservable(
            "the holes that were seen are on one line: measure one beside it", rank=5, unknowns=6
        )
    rays = np.column_stack(
        [evidence.camera.normalize(evidence.pixels), np.ones(len(evidence.pixels))]
    )
    directions = np.einsum("mji,mj->mi", evidence.rotations, rays)
    origins = -np.einsum("mji,mj->mi", evidence.rotations, evidence.translations)
    flat = origins - directions * (origins[:, 2] / directions[:, 2])[:, None]
    return kabsch(evidence.offsets, flat)
