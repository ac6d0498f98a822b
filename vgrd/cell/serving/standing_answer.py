"""The answer in the registers, and the pictures that vouch for it as long as it stands.

An answer that has ended never comes back: whatever ends it (a fault, an object that moved, a camera
that shows nothing any more) takes it out of the registers for good, and the robot asks again.
"""

import secrets
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
import structlog

from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.serving.answering import Limits
from vgrd.cell.serving.faults import Fault
from vgrd.cell.serving.vouching import Vouch, displacement_mm
from vgrd.clock import Clock
from vgrd.geometry import Array, Pose
from vgrd.model import Policy, TagObservation
from vgrd.registers import Answer, Status

SIGHTS_KEPT = 4  # of tag B: the one that is answered from, and earlier ones to agree with it
SEQ_BITS = 15  # of the register, beside the bit that tells whether it is valid
EARLIER_PERIODS = 2.5  # of unasked pictures: an older one may show another place by chance

log = structlog.get_logger()


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What a valid answer rests on.

    base_from_wrist: what was answered, for a target and under a policy. points: (n, 3) mm in tag B,
    as `vouching.points_in_tag`. tag_b, stamp_s: of the picture that the answer was computed from.
    latest_stamp_s: exposure of the newest picture that shows the object at the same place. hidden: the
    newest picture of all does not show tag B.
    """

    base_from_wrist: Pose
    target: str
    policy: Policy
    points: Array
    tag_b: TagObservation
    stamp_s: float
    latest_stamp_s: float
    hidden: bool = False


class StandingAnswer:
    """Holds one answer, judges it by every new picture, and withdraws it when it ends."""

    def __init__(self, measuring: Measuring, limits: Limits, clock: Clock) -> None:
        # A reader of single registers may be so slow that another life of the cell answers meanwhile.
        self.answer = Answer(seq=secrets.randbits(SEQ_BITS))
        self.basis: Basis | None = None
        self.vouch = Vouch(measuring.watch_period_s)
        self._measuring = measuring
        self._limits = limits
        self._clock = clock
        self._sights_of_tag_b: deque[Sight] = deque(maxlen=SIGHTS_KEPT)
        self._latest: Sight | None = None

    @property
    def is_held(self) -> bool:
        """Whether the answer stands although tag B is hidden."""
        return self.basis is not None and self.basis.hidden

    def settle(self, answer: Answer, basis: Basis | None) -> None:
        """Let `answer` stand from now on, on `basis`; without a basis it is a refusal."""
        self.answer = replace(answer, seq=self.answer.seq + 1)
        self.basis = basis
        self._measuring.watching = basis is not None
        if basis is None:
            self.vouch.end()
        else:
            self.vouch.begin(self._clock.monotonic())
        if answer.nonce and not answer.status.is_ok and answer.status is not Status.IDLE:
            log.warning("answer", status=answer.status.name, point=answer.point)

    def current(self, fault: Fault | None, now_s: float) -> Answer:
        """The answer as it is published now; an answer that cannot stand any longer is withdrawn."""
        if self.answer.status.is_ok and (status := self._objection(fault, now_s)):
            self.withdraw(status)
        if self.answer.status.is_ok:
            until_s = min(self.answer.valid_until_s, self.vouch.until_s)
            return replace(self.answer, valid_until_s=until_s)
        if fault is not None and self.answer.status is Status.IDLE:
            return replace(self.answer, status=fault[0])
        return self.answer

    def watch(self, sight: Sight) -> bool:
        """Judge the answer by a new picture; False when the picture says nothing about it."""
        self.vouch.learn(sight.stamp_s, self._clock.monotonic(), whole=sight.is_whole)
        self._latest = sight
        if sight.tag_b is not None:
            self._sights_of_tag_b.append(sight)
        basis = self.basis
        if basis is None or sight.stamp_s <= basis.stamp_s:
            return False
        if sight.tag_b is None:
            self.basis = replace(basis, hidden=True)
            until_s = basis.latest_stamp_s + self._limits.hold.longest_s
            self.vouch.hold(until_s, sight.stamp_s, whole=sight.is_whole)
            return True
        moved_mm = displacement_mm(basis.points, basis.tag_b, sight.tag_b)
        if not moved_mm <= self._limits.moved_mm:  # not a number counts as moved
            log.warning("object_moved", moved_mm=round(moved_mm, 3))
            self.withdraw(Status.OBJECT_MOVED)
        else:
            self.basis = replace(basis, latest_stamp_s=sight.stamp_s, hidden=False)
            self.vouch.see(sight.stamp_s, whole=sight.is_whole)
        return True

    def newest_sight(self) -> Sight | None:
        """The newest picture, if it is whole, shows tag B, and pictures come as they should."""
        sight = self._measuring.sight
        if sight is None or sight.tag_b is None or self._measuring.camera_blind():
            return None
        age_s = self._clock.monotonic() - sight.stamp_s
        is_fresh = age_s <= self.vouch.fresh_s(self._measuring.period_s)
        return sight if self._latest is sight and is_fresh else None

    def earlier_tag_b(self, stamp_s: float) -> TagObservation | None:
        """Tag B in the newest picture before that of `stamp_s`, unless that is long ago."""
        oldest_s = stamp_s - EARLIER_PERIODS * self._measuring.period_s
        sights = [sight for sight in self._sights_of_tag_b if oldest_s <= sight.stamp_s < stamp_s]
        return sights[-1].tag_b if sights else None

    def contradiction(self, basis: Basis) -> Status | None:
        """What the newest picture says against an answer that was computed from an older one."""
        latest = self._latest
        if latest is None or latest.stamp_s <= basis.stamp_s:
            return None
        return self.disagreement(basis, latest)

    def disagreement(self, basis: Basis, sight: Sight) -> Status | None:
        """Why a picture does not show the object where the answer has it; None when it does."""
        if sight.tag_b is None:
            return Status.TAG_B_NOT_FOUND
        moved_mm = displacement_mm(basis.points, basis.tag_b, sight.tag_b)
        return None if moved_mm <= self._limits.moved_mm else Status.OBJECT_MOVED

    def withdraw(self, status: Status, detail: int = 0) -> None:
        """End the answer for good."""
        log.warning("answer_withdrawn", status=status.name, point=self.answer.point)
        self.answer = replace(self.answer, status=status, detail=detail, seq=self.answer.seq + 1)
        self.basis = None
        self._measuring.watching = False
        self.vouch.end()

    def _objection(self, fault: Fault | None, now_s: float) -> Status | None:
        """Why the present answer cannot stand any longer; None while it can."""
        if fault is not None:
            return fault[0]
        if self._measuring.camera_blind():
            return Status.CAMERA_OFFLINE
        if not now_s < self.answer.valid_until_s:
            return Status.IMAGE_TOO_OLD
        basis = self.basis
        if basis is None or (basis.hidden and not self._may_hold(basis, now_s)):
            return Status.TAG_B_NOT_FOUND
        return None if now_s < self.vouch.until_s else Status.GRAB_TIMEOUT

    def _may_hold(self, basis: Basis, now_s: float) -> bool:
        """Whether an answer may stand without its tag: for a while, the arm near the coordinate."""
        hold = self._limits.hold
        reading = self._measuring.reading()
        if reading is None or not now_s < basis.latest_stamp_s + hold.longest_s:
            return False
        way = reading.base_from_wrist.translation - basis.base_from_wrist.translation
        return float(np.linalg.norm(way)) <= hold.approach_mm
