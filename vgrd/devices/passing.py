"""Where a moving arm passed at an instant: between the readings before and after it."""

from collections.abc import Sequence

import numpy as np

from vgrd.devices import FlangeReading
from vgrd.devices.rate import LONGEST_PERIOD_S
from vgrd.geometry import Pose
from vgrd.geometry.track import PoseTrack

_AROUND = 2  # readings on either side: what a cubic between them needs


def passing_pose(readings: Sequence[FlangeReading], stamp_s: float) -> Pose | None:
    """The flange at `stamp_s`, None where no readings surround it closely enough."""
    ordered = sorted(readings, key=lambda reading: reading.stamp_s)
    before = [reading for reading in ordered if reading.stamp_s <= stamp_s][-_AROUND:]
    after = [reading for reading in ordered if reading.stamp_s > stamp_s][:_AROUND]
    near = [*before, *after]
    if not before or not after or before[-1].stamp_s == after[0].stamp_s:
        return None
    track = PoseTrack.of([r.stamp_s for r in near], [r.base_from_wrist for r in near])
    instant = np.array([stamp_s])
    if not track.covers(instant, LONGEST_PERIOD_S).all():
        return None
    R, p = track.at(instant)
    return Pose(R[0], p[0])
