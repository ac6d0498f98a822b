"""The time between poses and pictures of a session, from what it recorded of the moving arm."""

from bisect import bisect_left
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.timing import WIDEST_S, TimeOffset, find_time_offset
from vgrd.errors import CalibrationError, InputError, StoreError
from vgrd.geometry.track import PoseTrack
from vgrd.judging.findings import finding
from vgrd.model import Finding, Recording
from vgrd.store.sessions import iterate_flanges, iterate_moving

_SIGMAS = 4.0  # 1 in 16,000 good sessions is told of an offset
_MOST_PICTURES = 400  # more hardly tell more: 100 give 0.1 ms
_NEAR_S = 1.0  # of a reading to a picture: the widest offset, and what interpolation needs besides
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
        moving = moving[:: -(-len(moving) // _MOST_PICTURES)]
        rests = [*recording.looks, *recording.spins, *recording.touch_pictures]
        stamps = sorted([*(one.stamp_s for one in moving), *(one.stamp_s for one in rests)])
        near = [r for r in iterate_flanges(folder) if _is_near(r.stamp_s, stamps)]
        track = PoseTrack.of([r.stamp_s for r in near], [r.base_from_wrist for r in near])
        return find_time_offset(
            recording.facts, track, moving, rests, calibration.base_from_camera, wrist_from_tag_a
        )
    except (StoreError, InputError, CalibrationError, np.linalg.LinAlgError) as err:
        return TimeOffset(unknown=str(err))


def _is_near(stamp_s: float, stamps: Sequence[float]) -> bool:
    """Whether a reading is of use for any picture: a session may hold hours of them."""
    i = bisect_left(stamps, stamp_s - _NEAR_S)
    return i < len(stamps) and stamps[i] <= stamp_s + _NEAR_S


def late_pictures(offset: TimeOffset) -> tuple[Finding, ...]:
    """A finding where the offset is known and matters."""
    if offset.unknown or abs(offset.offset_s) <= max(_SIGMAS * offset.sigma_s, _MATTERS_S):
        return ()
    ms, sigma_ms = 1e3 * offset.offset_s, 1e3 * offset.sigma_s
    remedy = f"set [camera] delay_ms = {1e3 * offset.delay_s:.0f}"
    if not 0 <= offset.delay_s <= WIDEST_S:
        remedy = "no delay_ms mends that: see to the clock or the driver of camera and robot"
    return (
        finding(
            "picture_delay",
            f"pictures show the robot {abs(ms):.1f} +- {sigma_ms:.1f} ms {'after' if ms > 0 else 'before'} "
            f"the pose of their time; samples at rest do not suffer; {remedy}",
        ),
    )
