"""The reference picture (0): where tag B stood while the targets were touched."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.errors import TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import mean_pose
from vgrd.model import Touch, frozen_array

_MOVED_SQUARED = 40.0
_MOVED_MM = 0.05
_MOVED_RAD = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """camera_from_tag_b: mean over the touches; covariance (6, 6); moved: touches that disagree.

    scatter_mm: rms distance of the tag's origin from the mean.
    """

    camera_from_tag_b: Pose
    covariance: Array
    moved: tuple[int, ...]
    scatter_mm: float


def find_reference(touches: Sequence[Touch]) -> Reference:
    """Mean of tag B over all touches that saw it; the object stands still while touching.

    Raises TooFewObservations when no touch saw tag B.
    """
    seen = [
        (i, touch.observation.tag_b)
        for i, touch in enumerate(touches)
        if touch.observation is not None and touch.observation.tag_b is not None
    ]
    if not seen:
        raise TooFewObservations(
            "tag B was not seen in any touch, so there is no reference picture: "
            "touch with tag B in view"
        )
    poses = [tag.camera_from_tag for _, tag in seen]
    covariances = [tag.covariance for _, tag in seen]
    middle = _most_central(poses)
    moved = [
        i
        for (i, _), pose, covariance in zip(seen, poses, covariances, strict=True)
        if _differs(pose, poses[middle], covariance + covariances[middle])
    ]
    still = [k for k, (i, _) in enumerate(seen) if i not in moved]
    mean, covariance = mean_pose([poses[k] for k in still], [covariances[k] for k in still])
    scatter = [mean.distance(poses[k])[0] for k in still]
    return Reference(
        mean,
        frozen_array(covariance, 6, 6),
        tuple(moved),
        float(np.sqrt(np.mean(np.square(scatter)))),
    )


def _most_central(poses: Sequence[Pose]) -> int:
    """Index of the pose nearest to most others; 100 mm count as 1 rad."""
    distance = np.array([[np.dot(a.distance(b), (0.01, 1.0)) for b in poses] for a in poses])
    return int(np.argmin(np.median(distance, axis=1)))


def _differs(pose: Pose, other: Pose, covariance: Array) -> bool:
    mm, rad = pose.distance(other)
    xi = (pose @ other.inverse()).log()
    squared = float(xi @ np.linalg.solve(covariance, xi))
    return squared > _MOVED_SQUARED and (mm > _MOVED_MM or rad > _MOVED_RAD)
