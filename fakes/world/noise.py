"""Noise of what is touched and seen: draws cut as the paper's are, and poses of tags."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from vgrd.geometry import Array, Pose, exp_rotation, hat
from vgrd.model import TagObservation, TagSpec, frozen_array


def truncated_normal(
    rng: np.random.Generator, limit_sigmas: float, shape: int | tuple[int, ...]
) -> Array:
    """Draws from the standard normal distribution, cut at +-limit_sigmas."""
    tail = ndtr(-limit_sigmas)
    return np.asarray(ndtri(rng.uniform(tail, 1 - tail, shape)))


@dataclass(frozen=True, slots=True)
class Vision:
    """Noise of a tag's pose, in the camera across and along the view, and about the tag's axes."""

    lateral_mm: float
    depth_mm: float
    tilt_deg: float
    roll_deg: float

    def finer(self, times: float) -> "Vision":
        """The same, smaller."""
        return Vision(
            self.lateral_mm / times,
            self.depth_mm / times,
            self.tilt_deg / times,
            self.roll_deg / times,
        )

    def observe(
        self, rng: np.random.Generator, spec: TagSpec, camera_from_tag: Pose
    ) -> TagObservation:
        """A tag that truly stands at `camera_from_tag`; its covariance is that of the noise."""
        shift = np.array([self.lateral_mm, self.lateral_mm, self.depth_mm])
        turn = np.radians([self.tilt_deg, self.tilt_deg, self.roll_deg])
        R = camera_from_tag.rotation @ exp_rotation(rng.normal(size=3) * turn)
        pose = Pose(R, camera_from_tag.translation + rng.normal(size=3) * shift)
        G = np.zeros((6, 6))
        G[:3, :3] = np.eye(3)
        G[3:, 3:] = pose.rotation
        G[:3, 3:] = hat(pose.translation) @ pose.rotation
        covariance = (G * np.concatenate([shift, turn]) ** 2) @ G.T
        return TagObservation(spec, pose, frozen_array(covariance, 6, 6), np.zeros((4, 2)), 0.0)


COARSE = Vision(0.01, 0.06, 0.03, 0.006)  # a guess, near a tag of 25 mm in the fake camera
FINE = COARSE.finer(20)  # so little that touches and arm are all that is left
