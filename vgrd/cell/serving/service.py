"""What the registers say: one answer at a time, watched for as long as it is valid.

An answer that has ended never comes back: whatever ends it (a fault, an object that moved, a camera
that shows nothing any more) takes it out of the registers for good, and the robot asks again.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import structlog

from vgrd.calibration.calibration import Calibration
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.serving.answering import Limits, answer_request, check_request
from vgrd.cell.serving.vouching import Vouch, agree, displacement_mm, points_in_tag
from vgrd.clock import Clock
from vgrd.errors import (
    CalibrationError,
    ControlError,
    DeviceUnavailable,
    InputError,
    VgrdError,
)
from vgrd.geometry import Array, Pose
from vgrd.ipc.ring import RingWriter
from vgrd.model import TagObservation
from vgrd.registers import Answer, Command, RegisterImage, Request, State, Status, reply

PUBLISH_S = 0.02
TCP_CHANGED_MM = 0.05
TCP_CHANGED_RAD = 2e-4
DRIFT_PICTURES = 3
PICTURE_SHARE = 0.8  # of a request's time, so that the reason arrives before the gate's timeout
SIGHTS_KEPT = (
    4  # of tag B: the one that a request is answered from, and earlier ones to agree with it
)
EARLIER_PERIODS = (
    2.5  # of the pictures taken unasked: an older one may show another place by chance
)

log = structlog.get_logger()


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What a valid answer rests on.

    points: (n, 3) mm in tag B, as `vouching.points_in_tag`; tag_b: the picture that was answered
    from; seen_s: exposure of the newest picture that shows the object there; hidden: the newest
    picture of all does not show tag B.
    """

    base_from_wrist: Pose
    points: Array
    tag_b: TagObservation
    stamp_s: float
    seen_s: float
    hidden: bool = False


class Serving:
    """Holds the active calibration and the answer; publishes the register image."""

    def __init__(
        self,
        measuring: Measuring,
        ring: RingWriter,
        limits: Limits,
        drift_mm: float,
        clock: Clock,
        *,
        simulation: bool,
    ) -> None:
        self.measuring = measuring
        self.ring = ring
        self.limits = limits
        self.drift_mm = drift_mm
        self.clock = clock
        self.simulation = simulation
        self.calibration: Calibration | None = None
        self.calibration_id = 0
        self.absence = (Status.STARTING, "the calibration is being loaded")
        self.answer = Answer()
        self.on_latch: list[Callable[[tuple[Status, str] | None], None]] = []
        self._latched: tuple[Status, str] | None = None
        self.vouch = Vouch(measuring.watch_period_s)
        self._basis: Basis | None = None
        self._sights: deque[Sight] = deque(maxlen=SIGHTS_KEPT)
        self._latest: Sight | None = None
        self._drifting = 0
        self._tasks: asyncio.TaskGroup | None = None
        self._work: asyncio.Task[None] | None = None
        measuring.on_watch.append(self._watch)

    @property
    def latched(self) -> tuple[Status, str] | None:
        """A fault that stands until a person confirms that its cause is gone."""
        return self._latched

    @latched.setter
    def latched(self, fault: tuple[Status, str] | None) -> None:
        if fault != self._latched:
            self._latched = fault
            for keep in self.on_latch:
                keep(fault)

    async def run(self) -> None:
        """Publish until cancelled; requests are worked on meanwhile."""
        async with asyncio.TaskGroup() as self._tasks:
            while True:
                self._guard_tcp()
                self.publish()
                await asyncio.sleep(PUBLISH_S)

    def use(self, calibration: Calibration | None, calibration_id: int) -> None:
        """Serve with `calibration` from now on; the present answer is dropped."""
        self.calibration, self.calibration_id = calibration, calibration_id
        self._drifting = 0
        dropped = self.answer
        self._settle(
            Answer(
                echo=dropped.echo,
                nonce=dropped.nonce,
                point=dropped.point,
                object=dropped.object,
            ),
            None,
        )

    def serve_none(self, status: Status, reason: str) -> None:
        """Serve nothing from now on; status and reason say why there is no calibration."""
        self.absence = (status, reason)
        self.use(None, 0)

    def confirm(self) -> None:
        """Forget a latched fault; ControlError while its cause is there, or cannot be looked for."""
        if self.latched and self.calibration is not None and self.measuring.reading() is None:
            trouble = self.measuring.robot_trouble()
            raise ControlError(f"nobody can tell whether the cause is gone: robot: {trouble}")
        trouble = self._tcp_trouble()
        if trouble:
            raise ControlError(f"the cause is still there: {trouble}")
        self.latched, self._drifting = None, 0

    def request(self, request: Request) -> None:
        """Start on a request while `run` runs; one that is being worked on is dropped (latest wins)."""
        if self._work is not None:
            self._work.cancel()
        if self._tasks is not None:
            self._work = self._tasks.create_task(self._serve(request))

    def abort(self) -> None:
        """Drop the answer and whatever is being worked on (TRIG 0)."""
        if self._work is not None:
            self._work.cancel()
        self._settle(Answer(), None)

    def fault(self) -> tuple[Status, str] | None:
        """Why nothing can be served at all now, None when something can."""
        if self.latched is not None:
            return self.latched
        if trouble := self.measuring.robot_trouble():
            return Status.ROBOT_OFFLINE, trouble
        reading = self.measuring.reading()
        if reading is not None and not reading.running:
            return Status.ROBOT_SAFETY_STOP, "the controller is not in normal mode"
        if self.calibration is None:
            return self.absence
        if self._drifting >= DRIFT_PICTURES:
            return Status.CALIBRATION_DRIFT, "tag A is not where the calibration puts it"
        if trouble := self.measuring.camera_trouble():
            return Status.CAMERA_OFFLINE, trouble
        return None

    def publish(self) -> None:
        """Write the register image: the answer while it stands, else why it does not."""
        fault, now = self.fault(), self.clock.monotonic()
        if self.answer.status.is_ok and (status := self._objection(fault, now)):
            self._end(status)
        answer = self.answer
        if answer.status.is_ok:
            until_s = min(answer.valid_until_s, self.vouch.until_s)
            answer = replace(answer, valid_until_s=until_s)
        elif fault is not None and answer.status is Status.IDLE:
            answer = replace(answer, status=fault[0])
        image = RegisterImage(answer, self._state(fault is None), self.measuring.beat, now)
        self.ring.publish(image.pack(), stamp_s=now)

    def _objection(self, fault: tuple[Status, str] | None, now_s: float) -> Status | None:
        """Why the present answer cannot stand any longer; None while it can."""
        if fault is not None:
            return fault[0]
        if self.measuring.camera_blind():
            return Status.CAMERA_OFFLINE
        if not now_s < self.answer.valid_until_s:
            return Status.IMAGE_TOO_OLD
        basis = self._basis
        if basis is None or (basis.hidden and not self._may_hold(basis, now_s)):
            return Status.TAG_B_NOT_FOUND
        return None if now_s < self.vouch.until_s else Status.GRAB_TIMEOUT

    async def _serve(self, request: Request) -> None:
        """Work on a request; it ends with an answer, whatever happens, unless a newer one came."""
        if request.command == Command.CLEAR:
            self._settle(reply(request, Status.IDLE), None)
            return
        answer, basis = reply(request, Status.INTERNAL_ERROR), None
        try:
            answer, basis = await self._answer(request)
        except asyncio.CancelledError:
            raise
        except (VgrdError, np.linalg.LinAlgError) as err:
            log.warning("request_refused", reason=str(err), error=type(err).__name__)
            answer = reply(request, status_of(err))
        except BaseException:
            self._settle(answer, None)  # a fault of ours: answered, then the process starts anew
            raise
        self._settle(answer, basis)

    async def _answer(self, request: Request) -> tuple[Answer, Basis | None]:
        """Answer a request with the calibration that is active when it comes, and still at its end."""
        fault, calibration = self.fault(), self.calibration
        if fault is not None or calibration is None:
            return reply(request, fault[0] if fault else self.absence[0]), None
        refusal = check_request(request, calibration)
        if refusal is not None:
            return refusal, None
        timeout_s = request.timeout_s or self.limits.timeout_s
        end_s = self.clock.monotonic() + PICTURE_SHARE * timeout_s
        sight = self._newest() if request.command == Command.EC_NEWEST else None
        sight = sight or await self._picture(end_s, whole=True)
        for _ in range(DRIFT_PICTURES):  # one picture may err about tag A, as many do not
            if sight is not None and self._drifting:
                sight = await self._picture(end_s, whole=True)
        if sight is None:
            return reply(request, self._blind_status()), None
        if self._drifting:
            return reply(request, Status.CALIBRATION_DRIFT), None
        answer, basis = self._judge(request, calibration, sight)
        doubt = None if basis is None else await self._doubt(basis, end_s)
        if doubt is None and basis is not None:
            doubt = self._contradiction(basis)
        if self.calibration is not calibration:  # another one was activated meanwhile
            doubt = Status.CALIBRATION_MISMATCH
        return (answer, basis) if doubt is None else (replace(answer, status=doubt), None)

    def _judge(
        self, request: Request, calibration: Calibration, sight: Sight
    ) -> tuple[Answer, Basis | None]:
        """What one picture says; a basis only for a coordinate."""
        now, wall = self.clock.monotonic(), self.clock.wall()
        answer, pose = answer_request(
            request, calibration, self.calibration_id, sight, self.limits, now, wall
        )
        if pose is None or sight.tag_b is None or not answer.status.is_ok:
            return answer, None
        points = points_in_tag(calibration, pose, sight.tag_b)
        return answer, Basis(pose, points, sight.tag_b, sight.stamp_s, sight.stamp_s)

    async def _picture(self, end_s: float, *, whole: bool) -> Sight | None:
        """A picture taken from now on, None when none comes until `end_s`."""
        if self.measuring.camera_trouble():
            return None
        try:
            return await self.measuring.fresh(end_s - self.clock.monotonic(), whole=whole)
        except DeviceUnavailable:
            return None

    def _newest(self) -> Sight | None:
        """The newest picture, if it is whole, shows tag B, and pictures come as they should."""
        sight = self.measuring.sight
        if sight is None or sight.tag_b is None or self.measuring.camera_blind():
            return None
        age_s = self.clock.monotonic() - sight.stamp_s
        is_fresh = age_s <= self.vouch.fresh_s(self.measuring.period_s)
        return sight if self._latest is sight and is_fresh else None

    def _contradiction(self, basis: Basis) -> Status | None:
        """What the newest picture, taken after that of the answer, says against it."""
        latest = self._latest
        if latest is None or latest.stamp_s <= basis.stamp_s:
            return None
        if latest.tag_b is None:
            return Status.TAG_B_NOT_FOUND
        moved_mm = displacement_mm(basis.points, basis.tag_b, latest.tag_b)
        return None if moved_mm <= self.limits.moved_mm else Status.OBJECT_MOVED

    async def _doubt(self, basis: Basis, end_s: float) -> Status | None:
        """Why one picture is not enough; None when a second one shows the object at the same place."""
        earlier = self._earlier(basis.stamp_s)
        if earlier is not None and agree(basis.points, earlier, basis.tag_b):
            return None
        second = await self._picture(end_s, whole=False)
        if second is None:
            return self._blind_status()
        if second.tag_b is None:
            return Status.TAG_B_NOT_FOUND
        moved_mm = displacement_mm(basis.points, basis.tag_b, second.tag_b)
        return None if moved_mm <= self.limits.moved_mm else Status.OBJECT_MOVED

    def _earlier(self, stamp_s: float) -> TagObservation | None:
        """Tag B in the newest picture before that of `stamp_s`, unless that is long ago."""
        oldest_s = stamp_s - EARLIER_PERIODS * self.measuring.period_s
        sights = [sight for sight in self._sights if oldest_s <= sight.stamp_s < stamp_s]
        return sights[-1].tag_b if sights else None

    def _blind_status(self) -> Status:
        """What to say when no picture came."""
        trouble = self.measuring.camera_trouble()
        return Status.CAMERA_OFFLINE if trouble else Status.GRAB_TIMEOUT

    def _settle(self, answer: Answer, basis: Basis | None) -> None:
        """Let `answer` stand from now on, on `basis`; without one it is a refusal."""
        self.answer = replace(answer, seq=self.answer.seq + 1)
        self._basis = basis
        self.measuring.watching = basis is not None
        if basis is None:
            self.vouch.end()
        else:
            self.vouch.begin(self.clock.monotonic())
        if answer.echo and not answer.status.is_ok and answer.status is not Status.IDLE:
            log.warning("answer", status=answer.status.name, point=answer.point)
        self.publish()

    def _end(self, status: Status) -> None:
        """Withdraw the answer for good."""
        log.warning("answer_withdrawn", status=status.name, point=self.answer.point)
        self.answer = replace(self.answer, status=status, seq=self.answer.seq + 1)
        self._basis = None
        self.measuring.watching = False
        self.vouch.end()

    def _watch(self, sight: Sight) -> None:
        """Each new picture may show that the object or the cell moved since the answer."""
        self.vouch.learn(sight.stamp_s, self.clock.monotonic(), whole=sight.is_whole)
        self._watch_drift(sight)
        self._latest = sight
        if sight.tag_b is not None:
            self._sights.append(sight)
        basis = self._basis
        if basis is None or sight.stamp_s <= basis.stamp_s:
            return
        if sight.tag_b is None:
            self._basis = replace(basis, hidden=True)
            until_s = basis.seen_s + self.limits.hold.longest_s
            self.vouch.hold(until_s, sight.stamp_s, whole=sight.is_whole)
        else:
            moved_mm = displacement_mm(basis.points, basis.tag_b, sight.tag_b)
            if not moved_mm <= self.limits.moved_mm:  # not a number counts as moved
                log.warning("object_moved", moved_mm=round(moved_mm, 3))
                self._end(Status.OBJECT_MOVED)
            else:
                self._basis = replace(basis, seen_s=sight.stamp_s, hidden=False)
                self.vouch.see(sight.stamp_s, whole=sight.is_whole)
        self.publish()

    def _may_hold(self, basis: Basis, now_s: float) -> bool:
        """Whether an answer may stand without its tag: for a while, the arm at or beyond its approach."""
        hold = self.limits.hold
        reading = self.measuring.reading()
        if reading is None or not now_s < basis.seen_s + hold.longest_s:
            return False
        way = reading.base_from_wrist.translation - basis.base_from_wrist.translation
        return float(np.linalg.norm(way)) <= hold.approach_mm

    def _watch_drift(self, sight: Sight) -> None:
        calibration = self.calibration
        if calibration is None or calibration.wrist_from_tag_a is None:
            return
        if sight.base_from_wrist is None or sight.tag_a is None:
            return
        J_camera = calibration.base_from_camera.compose(sight.tag_a.camera_from_tag)
        by_robot = sight.base_from_wrist.compose(calibration.wrist_from_tag_a)
        drift_mm, _ = J_camera.distance(by_robot)
        self._drifting = self._drifting + 1 if drift_mm > self.drift_mm else 0

    def _guard_tcp(self) -> None:
        trouble = self._tcp_trouble()
        if trouble and self.latched is None:
            log.error("tcp_changed", reason=trouble)
            self.latched = (Status.TCP_OFFSET_CHANGED, trouble)

    def _tcp_trouble(self) -> str:
        reading = self.measuring.reading()
        if self.calibration is None or reading is None:
            return ""
        return tcp_difference(self.calibration.facts.wrist_from_tcp, reading.wrist_from_tcp)

    def _state(self, ready: bool) -> State:
        reading = self.measuring.reading()
        sight = self.measuring.sight
        held = self._basis is not None and self._basis.hidden
        state = State(0)
        for flag, holds in (
            (State.READY, ready),
            (State.CAMERA_OK, not self.measuring.camera_blind()),
            (State.ROBOT_OK, reading is not None),
            (State.CALIBRATED, self.calibration is not None),
            (State.AT_REST, sight is not None and sight.base_from_wrist is not None),
            (State.TAG_A_SEEN, sight is not None and sight.tag_a is not None),
            (State.TAG_B_SEEN, sight is not None and sight.tag_b is not None and not held),
            (State.HELD, held),
            (State.SIMULATION, self.simulation),
        ):
            state |= flag if holds else State(0)
        return state


def status_of(error: Exception) -> Status:
    """What a robot is told when a request ends with an error of ours."""
    if isinstance(error, DeviceUnavailable):
        return Status.GRAB_TIMEOUT
    if isinstance(error, CalibrationError):
        return Status.CALIBRATION_MISMATCH
    return Status.BAD_PARAMETER if isinstance(error, InputError) else Status.INTERNAL_ERROR


def tcp_difference(calibrated: Pose | None, active: Pose | None) -> str:
    """In words, how the active TCP differs from the calibrated one; empty when it does not."""
    if calibrated is None or active is None:
        return ""
    mm, rad = calibrated.distance(active)
    if mm <= TCP_CHANGED_MM and rad <= TCP_CHANGED_RAD:
        return ""
    return (
        f"the active TCP on the pendant is {mm:.2f} mm, {1e3 * rad:.1f} mrad off the one that was "
        "active when the cell was calibrated: restore it there, then: vgrd confirm"
    )
