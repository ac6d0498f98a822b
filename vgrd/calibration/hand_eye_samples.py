"""What a recording holds for the hand-eye: every flange pose from which tag A was seen."""

from collections.abc import Sequence

from vgrd.calibration.hand_eye import PoseSample
from vgrd.geometry import Pose
from vgrd.model import Recording

_SAME_MM = 1e-6
_SAME_RAD = 1e-9


def sightings_of_tag_a(recording: Recording) -> list[PoseSample]:
    """All pictures with tag A but those of spins, in order of recording; verifications are held out."""
    named = [(f"look {i + 1}", seen) for i, seen in enumerate(recording.looks)]
    for kind, touches in (("touch", recording.touches), ("point", recording.points)):
        named += [
            (f"{kind} {i + 1} ({touch.target})", touch.observation)
            for i, touch in enumerate(touches)
            if touch.observation is not None
        ]
    return [
        PoseSample(name, seen.base_from_wrist, seen.tag_a.camera_from_tag, seen.tag_a.covariance)
        for name, seen in named
        if seen.tag_a is not None
    ]


def hand_eye_samples(recording: Recording) -> list[PoseSample]:
    """The first of them from every distinct flange pose."""
    samples: list[PoseSample] = []
    for sample in sightings_of_tag_a(recording):
        if not _is_repeated(sample.base_from_wrist, samples):
            samples.append(sample)
    return samples


def _is_repeated(pose: Pose, samples: Sequence[PoseSample]) -> bool:
    for other in samples:
        mm, rad = pose.distance(other.base_from_wrist)
        if mm < _SAME_MM and rad < _SAME_RAD:
            return True
    return False
