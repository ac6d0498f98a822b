"""Which rests become samples that nobody asked for: harvested looks and spins.

A rest is harvested when two pictures of it agree and it adds something: tag B stands as in no sample
before (a spin), or else the flange does and tag A is seen (a look). Samples of one place tell the
same again, so one of them is enough. When there are too many, the places must lie farther apart, and
those nearer to an earlier one are given back.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vgrd.geometry import Pose
from vgrd.model import CellFacts, Motion, Observation, Stability, TagObservation

STEADY_PX = 0.5  # of a corner: the noise of a good tag is a tenth of it
_MOST = 30  # of a kind: more samples than an operator ever gives, solved in seconds
_GROWTH = 1.5  # of the spacing when there are too many; some halve their number


class HarvestKind(StrEnum):
    """What a rest is good for; the values are those of the kinds of samples."""

    LOOK = "look"
    SPIN = "spin"


@dataclass(frozen=True, slots=True)
class Spacing:
    """How far apart two places are at least, by one or the other."""

    mm: float
    rad: float

    def are_apart(self, one: Pose, other: Pose) -> bool:
        """Whether the second place tells something else than the first."""
        mm, rad = one.distance(other)
        return mm >= self.mm or rad >= self.rad

    def grown(self) -> "Spacing":
        """The next wider one."""
        return Spacing(_GROWTH * self.mm, _GROWTH * self.rad)


_LOOKS = Spacing(30.0, float(np.radians(8)))  # chosen: over a table of 300 mm and 60 degrees
_SPINS = Spacing(10.0, float(np.radians(10)))  # chosen: 36 to a turn


@dataclass(frozen=True, slots=True, eq=False)
class Harvested:
    """A rest that became a sample; given_back: harvested samples that it makes superfluous."""

    kind: HarvestKind
    observation: Observation
    given_back: tuple[Observation, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """A sample of the session; kind: as what it was harvested, None for one that was asked for."""

    observation: Observation
    kind: HarvestKind | None


class Harvest:
    """Watches the pictures of one session; knows all its samples, asked for or not.

    most: harvested samples of a kind. Observations are told apart by what they are, not by content.
    """

    def __init__(self, facts: CellFacts, most: int = _MOST) -> None:
        self._is_movable = facts.camera_stability is Stability.MOVABLE
        self._turns = facts.object.motion is not Motion.FREE  # moving anyhow, it tells nothing
        self._most = most
        self._spacing = {HarvestKind.LOOK: _LOOKS, HarvestKind.SPIN: _SPINS}
        self._known: list[_Known] = []
        self._refused: list[Observation] = []
        self._before: Observation | None = None

    def consider(self, seen: Observation) -> Harvested | None:
        """The newest picture of an arm at rest, as a sample if it is to be one."""
        before, self._before = self._before, seen
        if before is None or not _are_steady(before, seen):
            return None
        if any(_is_same_stand(seen, refused) for refused in self._refused):
            return None
        kind = self._kind_of(seen)
        if kind is None:
            return None
        self._known.append(_Known(seen, kind))
        return Harvested(kind, seen, self._thinned(kind))

    def note(self, observation: Observation) -> tuple[Observation, ...]:
        """Take notice of a sample that was asked for; the harvested ones of this stand, which it replaces."""
        same = [k for k in self._known if k.kind and _is_same_stand(k.observation, observation)]
        self._known = [known for known in self._known if known not in same]
        self._known.append(_Known(observation, None))
        return tuple(known.observation for known in same)

    def refuse(self, observation: Observation) -> None:
        """Take notice that a sample was undone: its stand is not harvested, another one there may be."""
        self._known = [known for known in self._known if known.observation is not observation]
        self._refused.append(observation)

    def _kind_of(self, seen: Observation) -> HarvestKind | None:
        if self._is_new(seen, HarvestKind.SPIN) and self._is_of_another_turn(seen):
            return HarvestKind.SPIN
        return HarvestKind.LOOK if self._is_new(seen, HarvestKind.LOOK) else None

    def _is_of_another_turn(self, seen: Observation) -> bool:
        """Whether a place of the object was seen before; the first one is not turned, tag A rather tells."""
        if self._is_movable or seen.tag_a is None:
            return True
        return any(known.observation.tag_b is not None for known in self._known)

    def _is_new(self, seen: Observation, kind: HarvestKind) -> bool:
        """Whether no sample tells the same, seen from the place of its kind."""
        earlier = [known.observation for known in self._known]
        if kind is HarvestKind.LOOK:
            return (
                seen.tag_a is not None
                and not self._is_movable
                and all(
                    self._is_elsewhere(seen, sample)
                    for sample in earlier
                    if sample.tag_a is not None
                )
            )
        return (
            self._turns
            and self._object(seen) is not None
            and all(self._is_turned(seen, sample) for sample in earlier)
        )

    def _is_turned(self, seen: Observation, sample: Observation) -> bool:
        """Whether tag B stands otherwise than in a sample; where that shows none, it does.

        A movable camera tells it from one stand of the arm; from another one all is new to it.
        """
        here, there = self._object(seen), self._object(sample)
        if here is None or there is None:
            return True
        if self._is_movable and self._is_elsewhere(seen, sample):
            return True
        return self._spacing[HarvestKind.SPIN].are_apart(here, there)

    def _is_elsewhere(self, seen: Observation, sample: Observation) -> bool:
        """Whether the flange stands otherwise than in a sample."""
        spacing = self._spacing[HarvestKind.LOOK]
        return spacing.are_apart(seen.base_from_wrist, sample.base_from_wrist)

    def _object(self, seen: Observation) -> Pose | None:
        """Tag B, in the camera, or in tag A where the camera may stand anywhere; None if unseen."""
        if seen.tag_b is None:
            return None
        if not self._is_movable:
            return seen.tag_b.camera_from_tag
        if seen.tag_a is None:
            return None
        return seen.tag_a.camera_from_tag.inverse() @ seen.tag_b.camera_from_tag

    def _thinned(self, kind: HarvestKind) -> tuple[Observation, ...]:
        """Widen the spacing until there are not too many; the samples that are given back for it."""
        given_back: list[Observation] = []
        while sum(known.kind is kind for known in self._known) > self._most:
            self._spacing[kind] = self._spacing[kind].grown()
            thinned = [known for known in self._known if known.kind is kind]
            self._known = [known for known in self._known if known.kind is not kind]
            for known in thinned:
                if self._is_new(known.observation, kind):
                    self._known.append(known)
                else:
                    given_back.append(known.observation)
        return tuple(given_back)


def _are_steady(first: Observation, second: Observation) -> bool:
    """Whether two pictures are of one rest, in which nothing that both must show has moved."""
    same_tags = (first.tag_a is None, first.tag_b is None) == (
        second.tag_a is None,
        second.tag_b is None,
    )
    return same_tags and _is_same_rest(first, second) and moved_px(first, second) <= STEADY_PX


def _is_same_stand(one: Observation, other: Observation) -> bool:
    """Whether arm and object stand in one picture as in the other, without a move between them."""
    if not _is_same_rest(one, other):
        return False
    return shift_px(one.tag_b, other.tag_b) <= STEADY_PX


def _is_same_rest(one: Observation, other: Observation) -> bool:
    return one.rest_since_s is not None and one.rest_since_s == other.rest_since_s


def moved_px(first: Observation, second: Observation) -> float:
    """How far a corner of a tag moved between two pictures that both show it, px."""
    return max(shift_px(first.tag_a, second.tag_a), shift_px(first.tag_b, second.tag_b))


def shift_px(first: TagObservation | None, second: TagObservation | None) -> float:
    """How far a corner of a tag moved, px; 0 where it is not seen twice."""
    if first is None or second is None:
        return 0.0
    return float(np.abs(first.corners_px - second.corners_px).max())
