"""The reference picture (0): where the tags stood while the targets were touched."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import TooFewObservations
from vgrd.geometry import Array, Pose, exp_rotation, hat, log_rotation
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.coincidence import Difference
from vgrd.geometry.covariance import mean_pose
from vgrd.judging.thresholds import SAME_ORIENTATION_RAD
from vgrd.model import (
    Motion,
    Observation,
    Plan,
    Recording,
    Stability,
    TagObservation,
    Touch,
    frozen_array,
)

_NEAR = 0.3  # share of the pictures that tell their noise: fewer than stand still, or nothing does
_MOVED = Difference(squared=40.0, mm=0.05, rad=1e-3)  # 1 in 2 million; less does not matter
_TURNED_RAD = np.radians(10)  # far beyond a push, far below the turns that tell something
_ABOUT_AXIS = 0.9  # cosine: a tag taken for its mirror image turns about a line in its plane


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """camera_from_tag_b: mean over the touches; covariance (6, 6); outliers: touches that disagree.

    scatter_mm: rms distance of the tag's origin from the mean.
    """

    camera_from_tag_b: Pose
    covariance: Array
    outliers: tuple[int, ...]
    scatter_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceTagA:
    """Tag A in the reference picture: camera_from_tag_a with its covariance (6, 6), and where the flange stood."""

    camera_from_tag_a: Pose
    covariance: Array
    base_from_wrist: Pose


def find_reference(touches: Sequence[Touch]) -> Reference:
    """Mean of tag B over all touches that saw it; the object stands still while touching.

    Raises TooFewObservations when no touch saw tag B.
    """
    tags, outliers = _seen(touches), moved_touches(touches)
    if not tags:
        raise TooFewObservations(
            "tag B was not seen in any touch, so there is no reference picture: "
            "touch with tag B in view"
        )
    still = [tag for i, tag in tags if i not in outliers]
    poses = [tag.camera_from_tag for tag in still]
    mean, covariance = mean_pose(poses, [tag.covariance for tag in still])
    scatter = [mean.distance(pose)[0] for pose in poses]
    return Reference(
        mean,
        frozen_array(covariance, 6, 6),
        outliers,
        float(np.sqrt(np.mean(np.square(scatter)))),
    )


def find_reference_tag_a(recording: Recording) -> ReferenceTagA | None:
    """Mean of tag A over the touches with one wrist that saw both tags, else over the spins.

    The camera stands still and the wrist keeps its orientation: then tag A goes through the picture as
    the flange does through the base, and the mean of its places belongs to the mean of the flange's.
    """
    outliers = moved_touches(recording.touches)
    touches = [touch.observation for i, touch in enumerate(recording.touches) if i not in outliers]
    return _mean_tag_a(touches) or _mean_tag_a(recording.spins)


def _mean_tag_a(pictures: Sequence[Observation | None]) -> ReferenceTagA | None:
    """Of those with both tags whose wrist stands as in the first of them."""
    both = [
        (picture.base_from_wrist, picture.tag_a)
        for picture in pictures
        if picture is not None and picture.tag_a is not None and picture.tag_b is not None
    ]
    alike = [(W, tag) for W, tag in both if W.distance(both[0][0])[1] <= SAME_ORIENTATION_RAD]
    if not alike:
        return None
    tag_a = _mean([tag.camera_from_tag for _, tag in alike])
    covariance = np.zeros((6, 6))
    for _, tag in alike:
        J = np.eye(6)
        J[:3, 3:] = -hat(tag.camera_from_tag.translation - tag_a.translation)
        covariance += J @ tag.covariance @ J.T / len(alike) ** 2
    return ReferenceTagA(tag_a, frozen_array(covariance, 6, 6), _mean([W for W, _ in alike]))


def _mean(poses: Sequence[Pose]) -> Pose:
    """Mean of the places, and of the orientations, which are nearly one."""
    first = poses[0].rotation
    turns = [log_rotation(pose.rotation @ first.T) for pose in poses]
    R = exp_rotation(np.mean(turns, axis=0)) @ first
    return Pose(R, np.mean([pose.translation for pose in poses], axis=0))


def turned_touches(recording: Recording) -> tuple[int, ...]:
    """Touches of the object while it was turned on its table against most others, seen by tag B.

    The joint estimate takes them with their turn, which tells where the centre is. Only a camera that stands
    still sees it; the paper's methods have one place of the object.
    """
    facts = recording.facts
    is_still = facts.camera_stability is Stability.FIXED
    if recording.plan is not Plan.JOINT or facts.object.motion is Motion.FREE or not is_still:
        return ()
    tags = _seen(recording.touches)
    if not tags:
        return ()
    R = _most_central([tag for _, tag in tags]).camera_from_tag.rotation
    turns = {i: log_rotation(tag.camera_from_tag.rotation @ R.T) for i, tag in tags}
    axis = _axis_of(recording.spins)
    return tuple(
        i
        for i, turn in turns.items()
        if (angle := np.linalg.norm(turn)) > _TURNED_RAD
        and (axis is None or abs(axis @ turn) > _ABOUT_AXIS * angle)
    )


def _axis_of(spins: Sequence[Observation]) -> Array | None:
    """Unit vector (3,) of the largest turn of tag B since the first spin, in the camera; None without a turn."""
    rotations = [spin.tag_b.camera_from_tag.rotation for spin in spins if spin.tag_b is not None]
    turns = [log_rotation(R @ rotations[0].T) for R in rotations[1:]]
    widest = max(turns, key=lambda turn: float(np.linalg.norm(turn)), default=np.zeros(3))
    angle = float(np.linalg.norm(widest))
    return widest / angle if angle > _TURNED_RAD else None


def moved_touches(touches: Sequence[Touch]) -> tuple[int, ...]:
    """Touches that saw tag B elsewhere than most others did."""
    tags = _seen(touches)
    if not tags:
        return ()
    middle = _most_central([tag for _, tag in tags])
    near = [
        tag
        for _, tag in tags
        if tag is not middle
        and middle.camera_from_tag.distance(tag.camera_from_tag)[1] < _TURNED_RAD
    ]
    noise = _noise(near, middle)
    return tuple(
        i
        for i, tag in tags
        if _MOVED.is_between(
            tag.camera_from_tag,
            middle.camera_from_tag,
            noise * (tag.covariance + middle.covariance),
        )
    )


def _noise(tags: Sequence[TagObservation], middle: TagObservation) -> float:
    """Variance of tag B's pictures over the promised one, at least 1, by those nearest to the middle.

    A quantile below a half: an object that moved for some touches must not pass for noise.
    """
    squares = []
    for tag in tags:
        off = (tag.camera_from_tag @ middle.camera_from_tag.inverse()).log()
        squares.append(float(off @ np.linalg.solve(tag.covariance + middle.covariance, off)))
    if not squares:
        return 1.0
    return max(1.0, float(np.quantile(squares, _NEAR)) / chi2_quantile(_NEAR, 6))


def _seen(touches: Sequence[Touch]) -> list[tuple[int, TagObservation]]:
    return [
        (i, touch.observation.tag_b)
        for i, touch in enumerate(touches)
        if touch.observation is not None and touch.observation.tag_b is not None
    ]


def _most_central(tags: Sequence[TagObservation]) -> TagObservation:
    """The one seen nearest to most others; 100 mm count as 1 rad."""
    t = np.array([tag.camera_from_tag.translation for tag in tags])
    R = np.array([tag.camera_from_tag.rotation for tag in tags])
    mm = np.linalg.norm(t[:, None] - t, axis=2)
    cosine = (np.einsum("aij,bij->ab", R, R) - 1) / 2
    distance = 0.01 * mm + np.arccos(np.clip(cosine, -1, 1))
    return tags[int(np.argmin(np.median(distance, axis=1)))]
