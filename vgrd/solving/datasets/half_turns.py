"""Boards that look the same after a half turn: which way round each was is found from the robot."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import pose_from_points
from vgrd.vision.print.boards import BoardObservation


def turn_alike(
    base_from_wrist: Sequence[Pose], observations: Sequence[BoardObservation], camera: CameraModel
) -> list[BoardObservation]:
    """The observations, reversed where needed: robot and target turn by the same angles.

    One sample after the other is turned to agree best with those before it; the first stays.
    """
    chosen: list[BoardObservation] = []
    wrists: list[Array] = []
    targets: list[Array] = []
    for pose, observation in zip(base_from_wrist, observations, strict=True):
        choices = [observation, replace(observation, pixels=observation.pixels[::-1])]
        rotations = [_rotation(choice, camera) for choice in choices]
        misfits = [
            sum(
                abs(_angle(target, rotation) - _angle(wrist, pose.rotation))
                for wrist, target in zip(wrists, targets, strict=True)
            )
            for rotation in rotations
        ]
        best = int(np.argmin(misfits))
        chosen.append(choices[best])
        wrists.append(pose.rotation)
        targets.append(rotations[best])
    return chosen


def _rotation(observation: BoardObservation, camera: CameraModel) -> Array:
    resection = pose_from_points(observation.points_in_target, observation.pixels, camera)
    return resection.camera_from_target.rotation


def _angle(first: Array, second: Array) -> float:
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))
