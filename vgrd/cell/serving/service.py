"""Serves requests: from a request and pictures to the answer that stands in the registers."""

import asyncio
from dataclasses import replace

import numpy as np
import structlog

from vgrd.calibration.calibration import Calibration
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.serving.answering import (
    Limits,
    answer_request,
    check_request,
    micrometres,
    policy_of,
)
from vgrd.cell.serving.camera_memory import CameraMemory
from vgrd.cell.serving.faults import DRIFT_PICTURES, Fault, Faults
from vgrd.cell.serving.history import AnswerHistory
from vgrd.cell.serving.limits import carried_flange, excess_of, way_in_base
from vgrd.cell.serving.standing_answer import Basis, StandingAnswer
from vgrd.cell.serving.vouching import Vouch, agree, points_in_tag
from vgrd.clock import Clock
from vgrd.errors import CalibrationError, DeviceUnavailable, InputError, VgrdError
from vgrd.geometry import Array
from vgrd.ipc.ring import RingWriter
from vgrd.registers import Answer, Command, RegisterImage, Request, Status, reply
from vgrd.registers.limits import LIMIT_STATUS

PUBLISH_S = 0.02  # with the gate's tick (20 ms) the registers are 40 ms behind the cell at most
PICTURE_SHARE = 0.8  # of a request's time, so that the reason arrives before the gate's timeout

log = structlog.get_logger()


class Serving:
    """Answers requests with the active calibration; publishes the register image.

    `faults` says whether the cell can serve at all, `standing` holds the present answer.
    """

    def __init__(
        self,
        measuring: Measuring,
        ring: RingWriter,
        limits: Limits,
        stability: Array,
        clock: Clock,
        *,
        simulation: bool,
    ) -> None:
        self.measuring = measuring
        self.ring = ring
        self.limits = limits
        self.clock = clock
        self.simulation = simulation
        self.calibration_id = 0
        self.cameras = CameraMemory(stability)
        self.faults = Faults(measuring, self.cameras, clock)
        self.standing = StandingAnswer(measuring, limits, clock)
        self.history = AnswerHistory(clock)
        self._tasks: asyncio.TaskGroup | None = None
        self._work: asyncio.Task[None] | None = None
        measuring.on_watch.append(self._watch)

    @property
    def calibration(self) -> Calibration | None:
        """The calibration that serves."""
        return self.faults.calibration

    @property
    def answer(self) -> Answer:
        """The present answer."""
        return self.standing.answer

    @property
    def vouch(self) -> Vouch:
        """Until when pictures vouch for the present answer."""
        return self.standing.vouch

    async def run(self) -> None:
        """Publish until cancelled; requests are worked on meanwhile."""
        async with asyncio.TaskGroup() as self._tasks:
            while True:
                self.faults.check_tcp()
                self.publish()
                await asyncio.sleep(PUBLISH_S)

    def use(self, calibration: Calibration | None, calibration_id: int) -> None:
        """Serve with `calibration` from now on; the present answer is dropped."""
        self.calibration_id = calibration_id
        self.faults.use(calibration)
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
        self.faults.absence = (status, reason)
        self.use(None, 0)

    def confirm(self, *, is_adopted: bool = False) -> None:
        """Forget a latched fault; ControlError while its cause is there or cannot be looked for."""
        self.faults.confirm(is_adopted=is_adopted)

    def fault(self) -> Fault | None:
        """Why nothing can be served at all now, None when something can."""
        return self.faults.current()

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

    def publish(self) -> None:
        """Write the register image: the answer while it stands, else why it does not."""
        fault, now_s = self.fault(), self.clock.monotonic()
        answer = self.standing.current(fault, now_s)
        state = self.faults.state(
            is_ready=fault is None,
            is_held=self.standing.is_held,
            is_simulation=self.simulation,
        )
        image = RegisterImage(answer, state, self.measuring.beat, now_s)
        self.ring.publish(image.pack(), stamp_s=now_s)

    def _settle(self, answer: Answer, basis: Basis | None) -> None:
        self.standing.settle(answer, basis)
        self.publish()

    def _watch(self, sight: Sight) -> None:
        """Each new picture may show that the object or the cell moved since the answer."""
        self.faults.check_links(sight)
        if self.standing.watch(sight):
            self._check_bounds(sight)
            self.publish()

    def _check_bounds(self, sight: Sight) -> None:
        """End an answer whose target has moved out of the limits, were it by less than `moved_mm`."""
        basis, calibration = self.standing.basis, self.calibration
        if basis is None or calibration is None or sight.tag_b is None:
            return
        way = way_in_base(calibration, basis.tag_b, sight.tag_b)
        flange = carried_flange(calibration, basis.base_from_wrist, way, basis.policy)
        excess = excess_of(calibration, basis.target, flange, basis.policy, self.limits.bounds)
        if excess is not None:
            log.warning("moved_out_of_limits", reason=excess.words(basis.target))
            self.standing.withdraw(LIMIT_STATUS[excess.code], excess.code)

    async def _serve(self, request: Request) -> None:
        """Work on a request; it ends with an answer, whatever happens, unless a newer one came."""
        if request.command == Command.CLEAR:
            self._settle(reply(request, Status.IDLE), None)
            return
        answer, basis = reply(request, Status.INTERNAL_ERROR), None
        asked_s = self.clock.monotonic()
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
        self.history.note(answer, "" if basis is None else basis.target, asked_s)

    async def _answer(self, request: Request) -> tuple[Answer, Basis | None]:
        """Answer with the calibration that is active when the request comes, and still at its end."""
        fault, calibration = self.fault(), self.calibration
        if fault is not None or calibration is None:
            return self._refusal(request, fault or self.faults.absence), None
        refusal = check_request(request, calibration)
        if refusal is not None:
            return refusal, None
        timeout_s = request.timeout_s or self.limits.timeout_s
        asked_s = self.clock.monotonic()
        end_s = asked_s + PICTURE_SHARE * timeout_s
        sight = await self._sight_for(request, end_s)
        if sight is None:
            return reply(request, self._no_picture_status()), None
        if self.faults.is_drift_suspected:
            return self._refusal(request, (Status.CALIBRATION_DRIFT, "")), None
        answer, basis = self._judge(request, calibration, sight)
        doubt = None if basis is None else await self._doubt(basis, asked_s, end_s)
        if doubt is None and basis is not None:
            doubt = self.standing.contradiction(basis)
        if self.calibration is not calibration:  # another one was activated meanwhile
            doubt = Status.CALIBRATION_MISMATCH
        return (answer, basis) if doubt is None else (replace(answer, status=doubt), None)

    def _refusal(self, request: Request, fault: Fault) -> Answer:
        """The answer while nothing can be served."""
        answer = reply(request, fault[0])
        if fault[0] is not Status.CALIBRATION_DRIFT:
            return answer
        moved = micrometres(self.faults.moved_mm)
        return replace(answer, detail=self.faults.moved_links, moved_um=moved)

    async def _sight_for(self, request: Request, end_s: float) -> Sight | None:
        """The picture to answer from; more of them while something seems to have moved."""
        sight = self.standing.newest_sight() if request.command == Command.EC_NEWEST else None
        sight = sight or await self._picture(end_s, whole=True)
        for _ in range(DRIFT_PICTURES):
            if sight is not None and self.faults.is_drift_suspected:
                sight = await self._picture(end_s, whole=True)
        return sight

    def _judge(
        self, request: Request, calibration: Calibration, sight: Sight
    ) -> tuple[Answer, Basis | None]:
        """What one picture says; a basis only for a coordinate."""
        now_s, now_unix_s = self.clock.monotonic(), self.clock.wall()
        answer, expected = answer_request(
            request,
            calibration,
            self.calibration_id,
            sight,
            self.limits,
            now_s,
            now_unix_s,
            self.cameras.place(sight),
        )
        if expected is None or sight.tag_b is None or not answer.status.is_ok:
            return answer, None
        pose = expected.base_from_wrist
        points = points_in_tag(calibration, pose, sight.tag_b, expected.taught_from_camera)
        policy = policy_of(request, self.limits)
        stamp_s = sight.stamp_s
        basis = Basis(pose, expected.target.name, policy, points, sight.tag_b, stamp_s, stamp_s)
        return answer, basis

    async def _picture(self, end_s: float, *, whole: bool) -> Sight | None:
        """A picture taken from now on, None when none comes until `end_s`."""
        if self.measuring.camera_trouble():
            return None
        try:
            return await self.measuring.fresh(end_s - self.clock.monotonic(), whole=whole)
        except DeviceUnavailable:
            return None

    async def _doubt(self, basis: Basis, asked_s: float, end_s: float) -> Status | None:
        """Why one picture is not enough; None when a second one shows the object at the same place.

        That may be an earlier one, unless both are from long before the request: the object may have
        moved since.
        """
        is_new = basis.stamp_s >= asked_s or self.vouch.speaks(
            basis.stamp_s, self.clock.monotonic()
        )
        earlier = self.standing.earlier_tag_b(basis.stamp_s)
        if is_new and earlier is not None and agree(basis.points, earlier, basis.tag_b):
            return None
        second = await self._picture(end_s, whole=False)
        if second is None:
            return self._no_picture_status()
        return self.standing.disagreement(basis, second)

    def _no_picture_status(self) -> Status:
        """What to say when no picture came."""
        trouble = self.measuring.camera_trouble()
        return Status.CAMERA_OFFLINE if trouble else Status.GRAB_TIMEOUT


def status_of(error: Exception) -> Status:
    """What a robot is told when a request ends with an error of ours."""
    if isinstance(error, DeviceUnavailable):
        return Status.GRAB_TIMEOUT
    if isinstance(error, CalibrationError):
        return Status.CALIBRATION_MISMATCH
    return Status.BAD_PARAMETER if isinstance(error, InputError) else Status.INTERNAL_ERROR
