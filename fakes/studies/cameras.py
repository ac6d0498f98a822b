"""Cameras of the studies: one that is exactly where it was taught, a fixed one that gives a little, a movable one."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from fakes.world.simulation import Simulation
from vgrd.geometry import Array, Pose
from vgrd.model import CameraPlace, FlangeTag, Observation, frozen_array

EXACT = frozen_array(np.zeros(6), 6)
FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)  # the cell file's defaults, mm and rad
MOVABLE = frozen_array([np.inf] * 6, 6)
STABILITIES: Mapping[str, Array] = MappingProxyType(
    {"exact": EXACT, "fixed": FIXED, "movable": MOVABLE}
)
_CARRIED = frozen_array([60.0] * 3 + [0.2] * 3, 6)  # a guess: a hand's breadth and 11 degrees


def move(cell: Simulation, stability: Array, taught: Pose = Simulation.base_from_camera) -> None:
    """Displace the camera from where it was taught (base_from_camera) as its stability says; a movable one anyhow."""
    if stability.any():
        sigmas = np.where(np.isfinite(stability), stability, _CARRIED)
        taught_from_camera = Pose.exp(cell.rng.normal(size=6) * sigmas)
        cell.base_from_camera = taught @ taught_from_camera


def place_in(picture: Observation, stability: Array) -> CameraPlace:
    """Where the camera may stand in a picture, tag A in it as far as it is seen."""
    return CameraPlace(stability, FlangeTag.of(picture))
