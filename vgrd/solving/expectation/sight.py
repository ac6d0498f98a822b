"""A tag as a pinhole camera would see it: where it truly is, its covariance that of four corners."""

import numpy as np

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagObservation, TagSpec, frozen_array

_SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])


def sight_of(
    camera: CameraModel, tag: TagSpec, camera_from_tag: Pose, corner_px: float
) -> TagObservation:
    """The tag where it is, mm, every corner good to corner_px per axis, 1 sigma, by itself.

    Raises InputError for a tag that is not in front of the camera.
    """
    corners = camera_from_tag @ (tag.size_mm * _SQUARE)
    if corners[:, 2].min() < tag.size_mm:
        raise InputError(
            f"the camera is so near that tag {tag.id} passes beside it: give a larger --distance-mm, or a shorter "
            "--tool-mm"
        )
    pixels, D = camera.linearize(corners)
    J = np.concatenate([D, -D @ hat(corners)], axis=2).reshape(8, 6)
    covariance = corner_px**2 * np.linalg.inv(J.T @ J)
    return TagObservation(
        tag,
        camera_from_tag,
        frozen_array(covariance, 6, 6),
        frozen_array(pixels, 4, 2),
        corner_px,
    )


def edge_px(seen: TagObservation) -> float:
    """Shortest edge of the tag in the picture."""
    edges = np.roll(seen.corners_px, -1, axis=0) - seen.corners_px
    return float(np.linalg.norm(edges, axis=1).min())


def incidence_rad(camera_from_tag: Pose) -> float:
    """Angle between the tag's normal and the line of sight."""
    sight: Array = camera_from_tag.translation / np.linalg.norm(camera_from_tag.translation)
    return float(np.arccos(np.clip(abs(camera_from_tag.rotation[:, 2] @ sight), 0.0, 1.0)))


def is_in_picture(seen: TagObservation, camera: CameraModel) -> bool:
    """Whether all of it is."""
    corners = seen.corners_px
    return bool((corners >= 0).all() and (corners <= np.array(camera.size_px) - 1).all())
