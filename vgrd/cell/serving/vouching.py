"""How long an answer may stand on what the camera has shown: pure, times passed in.

An answer is a statement about where the object is now. It holds only while pictures keep coming
that show the object where the answer has it. `Vouch` says until when the last of them speaks;
`displacement_mm` says how far the object has moved between two of them.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.geometry import Array, Pose, hat
from vgrd.model import TagObservation

MARGIN_S = 0.1  # for the machine's scheduling, beyond the pictures' own time (decision 7)
LATENCIES = 5  # newest pictures of which the slowest counts (decision 7)
SLOWEST_S = 1.0  # a camera that is slower than this vouches no longer for it
AGREEMENT_SIGMAS = 5.0  # the largest of some ten points: 1e-5 false disagreements a picture
AGREEMENT_MM = 0.02  # what a standing table trembles, beside the noise of pictures


def points_in_tag(
    calibration: Calibration,
    answer: Pose,
    tag_b: TagObservation,
    taught_from_camera: Pose | None = None,
) -> Array:
    """Points (n, 3), mm, in tag B, that must not move while an answer stands.

    answer: the flange (base_from_wrist) that was answered from the picture of `tag_b`;
    taught_from_camera: how the camera had moved then. The points are flange and work tip, as answered
    and as every target was taught.
    """
    moved = taught_from_camera or Pose.identity()
    tip = calibration.tcp_in_wrist
    work = None if tip is None else np.asarray(tip) + calibration.facts.tool.work_from_touch_mm
    taught = [
        Pose(point.base_from_work, point.flange_in_base) for point in calibration.taught.values()
    ]
    tag_from_base = [
        (calibration.base_from_camera @ camera_from_tag).inverse()
        for camera_from_tag in (
            calibration.solution.camera_from_tag_b,
            moved @ tag_b.camera_from_tag,
        )
    ]
    flanges = [tag_from_base[0] @ pose for pose in taught] + [tag_from_base[1] @ answer]
    points = [flange.translation for flange in flanges]
    if work is not None:
        points += [flange @ work for flange in flanges]
    return np.array(points)


def displacement_mm(points: Array, then: TagObservation, now: TagObservation) -> float:
    """Way (mm) of that of the points (n, 3), in tag B, which moved farthest between two pictures."""
    way = _ways(points, then, now)
    return float(np.linalg.norm(way, axis=1).max(initial=0.0))


def agree(points: Array, then: TagObservation, now: TagObservation) -> bool:
    """Whether two pictures show the object at one place, within the noise of both."""
    covariance = then.covariance + now.covariance
    for way, point in zip(_ways(points, then, now), points, strict=True):
        J = np.hstack([np.eye(3), -hat(now.camera_from_tag @ point)])
        sigma_mm = math.sqrt(float(np.trace(J @ covariance @ J.T)))
        if not np.linalg.norm(way) <= AGREEMENT_SIGMAS * sigma_mm + AGREEMENT_MM:
            return False
    return True


def _ways(points: Array, then: TagObservation, now: TagObservation) -> Array:
    return np.array(
        [now.camera_from_tag @ point - then.camera_from_tag @ point for point in points]
    ).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class Hold:
    """How long an answer may stand while the tag is hidden, and how near the arm must be to it.

    longest_s 0: not at all. approach_mm: from the answered flange; the arm hides the tag only there.
    """

    longest_s: float = 0.0
    approach_mm: float = 60.0  # as in the cell file


class Vouch:
    """Until when pictures of the object vouch for the present answer; times of the cell clock.

    `learn` is called for every picture, `begin` for each answer, `see` for each picture that shows the
    object in its place. A camera that sends regions is watched by regions, another one by whole
    pictures; what counts is the latency of that kind of picture.
    """

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.until_s = -math.inf
        self._latencies_s = {whole: deque[float](maxlen=LATENCIES) for whole in (False, True)}
        self._is_stalled = {False: False, True: False}

    @property
    def latency_s(self) -> float:
        """From exposure to evaluation, of the slowest of the last pictures of the watch."""
        return self._latency_s(whole=not self._latencies_s[False])

    @property
    def interval_s(self) -> float:
        """From one watch picture to the next: a slow one delays the next."""
        return max(self.period_s, self.latency_s)

    @property
    def span_s(self) -> float:
        """How long one picture of the watch speaks, from its exposure on."""
        return _span_s(self.period_s, self.latency_s)

    def fresh_s(self, whole_period_s: float) -> float:
        """How old the newest whole picture can be while they come as they should, every period."""
        return _span_s(whole_period_s, self._latency_s(whole=True))

    def speaks(self, stamp_s: float, now_s: float) -> bool:
        """Whether a whole picture of then still speaks when the first one of a watch that begins now comes."""
        return now_s - stamp_s <= self._latency_s(whole=True)

    def _latency_s(self, *, whole: bool) -> float:
        latencies_s = self._latencies_s[whole] or (self.period_s,)
        return min(max(latencies_s), SLOWEST_S)

    def learn(self, stamp_s: float, now_s: float, *, whole: bool) -> None:
        """A picture, exposed at `stamp_s`, was evaluated now.

        One that came after its successor was due tells of a stall, not of the camera: it counts
        only if the next one is as late. Answers after an outage would stand too long otherwise.
        The first picture of all counts until the next one comes in time.
        """
        latency_s = now_s - stamp_s
        latencies_s, was_stalled = self._latencies_s[whole], self._is_stalled[whole]
        is_late = latency_s > _span_s(self.period_s, self._latency_s(whole=whole))
        if was_stalled and not is_late and len(latencies_s) == 1:
            latencies_s.clear()
        if not is_late or was_stalled or not latencies_s:
            latencies_s.append(latency_s)
        self._is_stalled[whole] = is_late

    def begin(self, now_s: float) -> None:
        """An answer was given now: the first watch picture is on its way."""
        self.until_s = now_s + self.interval_s + MARGIN_S

    def see(self, stamp_s: float, *, whole: bool) -> None:
        """A picture, exposed at `stamp_s`, shows the object where the answer has it."""
        self.until_s = stamp_s + self._vouched_s(whole=whole)

    def hold(self, until_s: float, stamp_s: float, *, whole: bool) -> None:
        """A picture shows no tag; the answer stands until then, as long as pictures go on coming."""
        self.until_s = min(until_s, stamp_s + self._vouched_s(whole=whole))

    def _vouched_s(self, *, whole: bool) -> float:
        """A whole picture takes its own time, and the next one may be whole too."""
        latency_s = max(self._latency_s(whole=True), self.latency_s) if whole else self.latency_s
        return _span_s(self.period_s, latency_s)

    def end(self) -> None:
        """No answer stands."""
        self.until_s = -math.inf


def _span_s(period_s: float, latency_s: float) -> float:
    """How long a picture speaks, from its exposure on: until the next should have been evaluated."""
    return max(period_s, latency_s) + latency_s + MARGIN_S
