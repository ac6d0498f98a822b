"""Where the object stood while it was touched: touches of one stand fit CAD together as they are.

Of different stands they do once the camera is tied to the robot: then tag B tells in the base how the object
moved between them, and each touch is brought to where it would be had the object not moved. Of a turntable whose
centre CAD tells, it shows where the part stands before the tool is known: the centre stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.hand_eye import HandEyeProblem, calibrate_hand_eye, hand_eye_samples
from vgrd.calibration.plausibility.rigid import PlacedTouches, StillPoints
from vgrd.calibration.touches import TouchSet, arm_touches
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.coincidence import Difference
from vgrd.judging.thresholds import NOISY_SCALE
from vgrd.model import Motion, ObjectSpec, Recording, Stability, TagObservation

_MOVED = Difference(squared=40.0, mm=0.05, rad=1e-3)  # as of the reference picture: 1 in 2 million
_TIED_MM = 5.0  # of the camera's place: with less certainty a half turn tells nothing to a few mm
_LEAST_LOOKS = 3  # of a hand-eye
_CENTER_MM = 0.5  # sigma of the centre at the least: names are tens of mm apart, and a wrong centre is for the solver
_LEAST_TURN_RAD = (
    0.1  # of one that tells the centre; chosen: a part that is pushed on its table turns by less
)
_NO_TURN = 1e-9  # of the largest singular value: along the axis, where turning moves nothing


@dataclass(frozen=True, slots=True, eq=False)
class Stands:
    """Which stand of the object each touch belongs to (-1: tag B was not seen), and how these came about."""

    of: tuple[int, ...]
    tags: tuple[TagObservation, ...]

    @classmethod
    def of_touches(cls, recording: Recording) -> "Stands":
        """By tag B in their pictures; a movable camera cannot tell: there the object is held to stand still."""
        is_movable = recording.facts.camera_stability is Stability.MOVABLE
        tags: list[TagObservation] = []
        of = []
        for touch in recording.touches:
            tag = None if touch.observation is None else touch.observation.tag_b
            if tag is None:
                of.append(-1)
                continue
            same = [k for k, other in enumerate(tags) if is_movable or _is_same(tag, other)]
            if not same:
                same = [len(tags)]
                tags.append(tag)
            of.append(same[0])
        return cls(tuple(of), tuple(tags))


def _is_same(tag: TagObservation, other: TagObservation) -> bool:
    covariance = tag.covariance + other.covariance
    return not _MOVED.is_between(tag.camera_from_tag, other.camera_from_tag, covariance)


def placed_as_touched(recording: Recording, indices: Sequence[int]) -> PlacedTouches:
    """Touches of targets in CAD that belong to one stand."""
    touches = [recording.touches[i] for i in indices]
    points = [recording.facts.object.targets[touch.target].cad for touch in touches]
    tips = arm_touches(touches, recording)
    still = np.full(len(touches), recording.facts.object.cad_sigma_mm)
    return PlacedTouches(np.array(points).reshape(-1, 3), _widened(tips, still))


def placed_in_one(
    recording: Recording, indices: Sequence[int], stands: Stands, tied: tuple[Pose, Array]
) -> PlacedTouches:
    """Touches of all stands as in the first one; tied: as `tied_camera` tells."""
    placed = placed_as_touched(recording, indices)
    camera, covariance = tied
    first = stands.tags[stands.of[indices[0]]]
    size_mm = _size_mm(recording)
    ways = {
        stand: _way_back(camera, covariance, first, stands.tags[stand], size_mm)
        for stand in {stands.of[i] for i in indices}
    }
    rotations, translations, sigmas = [], [], []
    for i in indices:
        back, sigma = ways[stands.of[i]]
        pose = back @ recording.touches[i].base_from_wrist
        rotations.append(pose.rotation)
        translations.append(pose.translation)
        sigmas.append(sigma)
    moved = replace(
        placed.touches, rotations=np.array(rotations), translations=np.array(translations)
    )
    turned = [way for stand, way in sorted(ways.items()) if stands.tags[stand] is not first]
    still = _still_center(recording.facts.object, turned)
    return PlacedTouches(placed.points, _widened(moved, np.array(sigmas)), still)


def _still_center(part: ObjectSpec, ways: Sequence[tuple[Pose, float]]) -> StillPoints:
    """The centre of turning by each way back, with its sigma: (R - I) x = -t tells x but along the axis."""
    center = part.center_in_object
    ways = [
        (back, sigma) for back, sigma in ways if np.linalg.norm(back.rotvec()) > _LEAST_TURN_RAD
    ]
    if center is None or part.motion is not Motion.TURNTABLE or not ways:
        return StillPoints()
    turns = np.array([back.rotation - np.eye(3) for back, _ in ways])
    shifts = np.array([back.translation for back, _ in ways])
    places = -np.einsum("kij,kj->ki", np.linalg.pinv(turns, rcond=_NO_TURN), shifts)
    center_mm = np.hypot(part.center_sigma_mm, _CENTER_MM)
    by_center = center_mm * np.linalg.norm(turns, ord=2, axis=(1, 2))
    sigmas = np.hypot([sigma for _, sigma in ways], by_center)
    points = np.tile(np.asarray(center), (len(ways), 1))
    return StillPoints(points, places, turns / sigmas[:, None, None])


def _widened(touches: TouchSet, sigmas_mm: Array) -> TouchSet:
    """With an error (m,) more per axis."""
    lateral = np.hypot(touches.lateral_sigma_mm, sigmas_mm)
    return replace(
        touches,
        lateral_sigma_mm=lateral,
        axial_sigma_mm=np.hypot(touches.axial_sigma_mm, sigmas_mm),
    )


def tied_camera(recording: Recording) -> tuple[Pose, Array] | None:
    """base_from_camera with its covariance (6, 6), left; None where the looks do not tell it well enough."""
    if recording.facts.camera_stability is Stability.MOVABLE:
        return None
    samples = hand_eye_samples(recording)
    if len(samples) < _LEAST_LOOKS:
        return None
    problem = HandEyeProblem(
        recording.facts.mount, samples, robot_sigma_mm=recording.facts.flange_sigma_mm
    )
    try:
        result = calibrate_hand_eye(problem)
    except CalibrationError:  # what the looks lack is told by the checks, in their words
        return None
    covariance = result.covariance[:6, :6]
    sigma_mm = float(np.sqrt(np.trace(covariance[:3, :3])))
    is_tied = sigma_mm <= _TIED_MM and result.noise_scale <= NOISY_SCALE
    return (result.mount_from_camera, covariance) if is_tied else None


def _way_back(
    camera: Pose, covariance: Array, first: TagObservation, tag: TagObservation, size_mm: float
) -> tuple[Pose, float]:
    """What moves the object in the base from a stand to the first one, and its sigma per axis, mm.

    covariance (6, 6): of base_from_camera, left. size_mm: how far from the tag a target may be.
    """
    if tag is first:
        return Pose.identity(), 0.0
    in_camera = first.camera_from_tag @ tag.camera_from_tag.inverse()
    back = camera @ in_camera @ camera.inverse()
    place = camera @ first.camera_from_tag.translation
    by_camera = np.hstack([np.eye(3), -hat(place)]) @ (np.eye(6) - back.adjoint())
    variance = float(np.trace(by_camera @ covariance @ by_camera.T)) / 3
    for seen in (first, tag):
        J = np.hstack([np.eye(3), -hat(seen.camera_from_tag.translation)])
        at_tag = float(np.trace(J @ seen.covariance @ J.T)) / 3
        variance += at_tag + size_mm**2 * float(np.trace(seen.covariance[3:, 3:])) / 3
    return back, float(np.sqrt(variance))


def _size_mm(recording: Recording) -> float:
    """Of the part: how far its targets in CAD lie apart at the most."""
    points = [
        t.cad for t in recording.facts.object.targets.values() if t.point_in_object is not None
    ]
    spread = np.ptp(np.array(points).reshape(-1, 3), axis=0) if points else np.zeros(3)
    return float(np.linalg.norm(spread))
