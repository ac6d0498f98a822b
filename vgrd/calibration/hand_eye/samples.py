"""What a recording holds for the hand-eye: every flange pose from which tag A was seen.

By a camera that people move, what tag B sees of tag A: while it is touched the object stands still.
"""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.hand_eye.fit import PoseSample
from vgrd.geometry import Pose
from vgrd.geometry.coincidence import equal_poses
from vgrd.judging.thresholds import SAME_POSE_MM, SAME_POSE_RAD
from vgrd.model import Recording, Stability


def sightings_of_tag_a(recording: Recording) -> list[PoseSample]:
    """All pictures with tag A but those of spins, in order of recording; verifications are held out.

    Of a movable camera, touches of the object that show both tags: target and camera are tags A and B.
    """
    if recording.facts.camera_stability is Stability.MOVABLE:
        return _seen_by_tag_b(recording)
    named = [(f"look {i + 1}", look) for i, look in enumerate(recording.looks)]
    for kind, touches in (("touch", recording.touches), ("point", recording.points)):
        named += [
            (f"{kind} {i + 1} ({touch.target})", touch.observation)
            for i, touch in enumerate(touches)
            if touch.observation is not None
        ]
    return [
        PoseSample(name, look.base_from_wrist, look.tag_a.camera_from_tag, look.tag_a.covariance)
        for name, look in named
        if look.tag_a is not None
    ]


def _seen_by_tag_b(recording: Recording) -> list[PoseSample]:
    samples = []
    for i, touch in enumerate(recording.touches):
        seen = touch.observation
        if seen is None or seen.tag_a is None or seen.tag_b is None:
            continue
        tag_b_from_camera = seen.tag_b.camera_from_tag.inverse()
        G = tag_b_from_camera.adjoint()
        samples.append(
            PoseSample(
                f"touch {i + 1} ({touch.target})",
                seen.base_from_wrist,
                tag_b_from_camera @ seen.tag_a.camera_from_tag,
                G @ (seen.tag_a.covariance + seen.tag_b.covariance) @ G.T,
            )
        )
    return samples


def hand_eye_samples(recording: Recording) -> list[PoseSample]:
    """The first of them from every distinct flange pose."""
    samples = sightings_of_tag_a(recording)
    first = first_of_same([sample.base_from_wrist for sample in samples])
    return [sample for i, sample in enumerate(samples) if first[i] == i]


def first_of_same(poses: Sequence[Pose]) -> list[int]:
    """For every pose (n) the index of the first one that equals it."""
    if not poses:
        return []
    return [int(i) for i in np.argmax(equal_poses(poses, SAME_POSE_MM, SAME_POSE_RAD), axis=1)]
