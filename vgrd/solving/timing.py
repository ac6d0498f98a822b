"""The time between poses and pictures of a session, from what it recorded of the moving arm."""

from itertools import chain
from pathlib import Path

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.timing import TimeOffset, find_time_offset
from vgrd.errors import InputError, StoreError
from vgrd.geometry.track import PoseTrack
from vgrd.judging.findings import finding
from vgrd.model import Finding, Recording
from vgrd.store.sessions import iterate_flanges, iterate_moving

_SIGMAS = 4.0  # 1 in 16,000 good sessions is told of an offset
_MATTERS_S = 0.01  # half of what is covered beside an exposure: `RestLimits.half_exposure_s`


def time_offset_of(folder: Path, recording: Recording, calibration: Calibration) -> TimeOffset:
    """What the pictures of the moving arm tell, or why they tell nothing; nothing is refused for it."""
    wrist_from_tag_a = calibration.wrist_from_tag_a
    if wrist_from_tag_a is None:
        return TimeOffset(unknown="tag A is not used")
    try:
        moving = list(iterate_moving(folder))
        if not moving:
            return TimeOffset(unknown="the session has no pictures of the moving arm")
        readings = list(iterate_flanges(folder))
        track = PoseTrack.of([r.stamp_s for r in readings], [r.base_from_wrist for r in readings])
    except (StoreError, InputError) as err:
        return TimeOffset(unknown=str(err))
    touched = (touch.observation for touch in recording.touches)
    rests = [seen for seen in chain(recording.looks, recording.spins, touched) if seen is not None]
    return find_time_offset(
        recording.facts, track, moving, rests, calibration.base_from_camera, wrist_from_tag_a
    )


def late_pictures(offset: TimeOffset) -> tuple[Finding, ...]:
    """A finding where the offset is known and matters."""
    if offset.unknown or abs(offset.offset_s) <= max(_SIGMAS * offset.sigma_s, _MATTERS_S):
        return ()
    ms, sigma_ms = 1e3 * offset.offset_s, 1e3 * offset.sigma_s
    return (
        finding(
            "picture_delay",
            f"pictures show the robot {abs(ms):.1f} +- {sigma_ms:.1f} ms {'after' if ms > 0 else 'before'} "
            f"the pose of their time; samples at rest do not suffer; set [camera] delay_ms = "
            f"{1e3 * offset.delay_s:.0f}",
        ),
    )
