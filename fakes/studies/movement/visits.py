"""A cell at work as its pictures tell: the arm visits its poses, the table turns, a picture every half second."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.joint import JointSolution
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose
from vgrd.model import (
    CameraPlace,
    CellFacts,
    FlangeTag,
    Instant,
    Link,
    LinkReport,
    Observation,
    TagObservation,
)

PERIOD_S = 0.5  # as `[camera] rate_hz` of the cell file
PICTURES = 6  # of one visit: three seconds
_SPREAD_MM = 80.0  # of the poses, about where the arm waits


class Visits:
    """Pictures of a cell in which one link may slip, and what the series of the solution says of them.

    poses: how many the arm visits. has_tag_a: whether tag A is in view.
    """

    def __init__(
        self,
        cell: Simulation,
        solution: JointSolution,
        facts: CellFacts,
        stability: Array,
        *,
        poses: int,
        has_tag_a: bool = True,
    ) -> None:
        self.series = solution.series(facts, stability)
        self._cell, self._stability, self._has_tag_a = cell, stability, has_tag_a
        offsets = cell.rng.uniform(-_SPREAD_MM, _SPREAD_MM, (poses, 3))
        at = cell.standing.translation
        self._stands = [Pose(WORK_ROTATION, at + offset) for offset in offsets]
        self._now_s = 0.0

    def go(
        self, visits: int, slip: Pose | None = None, link: Link = Link.TAG_B
    ) -> Iterator[LinkReport]:
        """So many visits, each of `PICTURES`; slip: of `link`, in its own frame, in all of them."""
        for _ in range(visits):
            stand = self._stands[int(self._cell.rng.integers(len(self._stands)))]
            since_s, angle = self._now_s, float(self._cell.rng.uniform(-np.pi, np.pi))
            for seen in self._pictures(stand, angle):
                self._now_s += PERIOD_S
                tag_a, tag_b = slipped(seen, link, slip or Pose.identity())
                flange_tag = FlangeTag(tag_a, stand) if self._has_tag_a else None
                place = CameraPlace(self._stability, flange_tag)
                instant = Instant(self._now_s, since_s, self._has_tag_a)
                yield self.series.see(tag_b, place, instant)

    def _pictures(self, stand: Pose, angle_rad: float) -> Sequence[Observation]:
        return self._cell.watch(stand, angle_rad, PICTURES)


def slipped(seen: Observation, link: Link, slip: Pose) -> tuple[TagObservation, TagObservation]:
    """Tag A and tag B of a picture after a link slipped in its own frame."""
    tag_a, tag_b = seen.tag_a, seen.tag_b
    if tag_a is None or tag_b is None:
        raise CalibrationError("a tag is not in the picture")
    if link is Link.CAMERA:
        back = slip.inverse()
        return _seen_at(tag_a, back @ tag_a.camera_from_tag), _seen_at(
            tag_b, back @ tag_b.camera_from_tag
        )
    if link is Link.TAG_A:
        return _seen_at(tag_a, tag_a.camera_from_tag @ slip), tag_b
    return tag_a, _seen_at(tag_b, tag_b.camera_from_tag @ slip)


def _seen_at(tag: TagObservation, camera_from_tag: Pose) -> TagObservation:
    return replace(tag, camera_from_tag=camera_from_tag)
