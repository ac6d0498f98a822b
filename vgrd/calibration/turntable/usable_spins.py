"""Spins that tell an axis of turning, and those that do not yet."""

from dataclasses import replace

from vgrd.calibration.turntable.rotation_center import find_rotation_center
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.judging.findings import finding
from vgrd.model import Finding, Motion, Recording


def without_useless_spins(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Leave the spins out until they tell the axis: the joint estimate would wander along it."""
    if not recording.spins or recording.facts.object.motion is Motion.FREE:
        return recording, ()
    tags = [spin.tag_b for spin in recording.spins if spin.tag_b is not None]
    try:
        find_rotation_center([tag.camera_from_tag for tag in tags])
    except (NotObservable, TooFewObservations) as err:
        doubt = finding("spins_unusable", f"the spins are not used: {err}")
        return replace(recording, spins=()), (doubt,)
    return recording, ()
