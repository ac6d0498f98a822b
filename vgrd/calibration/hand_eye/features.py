"""Points fixed to the target that pictures show beside it, such as holes of the part it is on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.judging.thresholds import UNKNOWN_MM


@dataclass(frozen=True, slots=True, eq=False)
class FeaturePlace:
    """Where a point is on the target: (3,) mm, and how well that is known, per axis."""

    point_in_target: Array
    sigma_mm: float


def first_places(
    sightings: Sequence[Mapping[str, Array]],
    camera_from_target: Sequence[Pose],
    camera: CameraModel,
    priors: Mapping[str, FeaturePlace],
) -> dict[str, FeaturePlace]:
    """Where the points that count are: as given, else where at least two lines of sight meet.

    sightings: pixels (2,) by name, one mapping a picture.
    """
    places = {}
    for name in dict.fromkeys(name for sighting in sightings for name in sighting):
        pictures = [i for i, sighting in enumerate(sightings) if name in sighting]
        if name in priors:
            places[name] = priors[name]
        elif len(pictures) > 1:
            directions = camera.normalize(np.array([sightings[i][name] for i in pictures]))
            place = _meeting_point(directions, [camera_from_target[i] for i in pictures])
            places[name] = FeaturePlace(place, UNKNOWN_MM)
    return places


def _meeting_point(directions: Array, camera_from_target: Sequence[Pose]) -> Array:
    """Nearest to all lines of sight (n, 2); where they are parallel, to the target's origin.

    Least squares of (x, y) - z (u, v) in every camera, each divided by the target's distance.
    """
    rows, right = [], []
    for (u, v), pose in zip(directions, camera_from_target, strict=True):
        across = np.array([[1.0, 0.0, -u], [0.0, 1.0, -v]]) / pose.translation[2]
        rows.append(across @ pose.rotation)
        right.append(-across @ pose.translation)
    A, b = np.concatenate(rows), np.concatenate(right)
    return np.asarray(np.linalg.lstsq(A, b, rcond=1e-4)[0])
