"""Spins that tell an axis of turning, and those that do not yet."""

from dataclasses import replace

from vgrd.calibration.turntable.rotation_center import find_rotation_center
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.judging.findings import finding
from vgrd.model import Finding, Motion, Recording, Stability


def turned_tags(recording: Recording) -> list[Pose]:
    """Tag B in the spins, as the camera saw it; by a movable one, as tag A sees it, the robot at rest."""
    if recording.facts.camera_stability is Stability.FIXED:
        return [spin.tag_b.camera_from_tag for spin in recording.spins if spin.tag_b is not None]
    return [
        spin.tag_a.camera_from_tag.inverse() @ spin.tag_b.camera_from_tag
        for spin in recording.spins
        if spin.tag_a is not None and spin.tag_b is not None
    ]


def without_useless_spins(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Leave the spins out until they tell the axis: the joint estimate would wander along it."""
    if not recording.spins or recording.facts.object.motion is Motion.FREE:
        return recording, ()
    try:
        find_rotation_center(turned_tags(recording))
    except (NotObservable, TooFewObservations) as err:
        doubt = finding("spins_unusable", f"the spins are not used: {err}")
        return replace(recording, spins=()), (doubt,)
    return recording, ()
