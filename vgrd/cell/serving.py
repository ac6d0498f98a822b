"""What the registers say: one answer at a time, watched for as long as it is valid."""

import asyncio
from dataclasses import replace

import structlog

from vgrd.cell.answering import Limits, answer_request, check_request, object_displacement_mm
from vgrd.cell.measuring import ROBOT_STALE_S, Measuring, Sight
from vgrd.clock import Clock
from vgrd.errors import CalibrationError, ControlError, DeviceUnavailable
from vgrd.geometry import Pose
from vgrd.ipc.ring import RingWriter
from vgrd.model import Calibration
from vgrd.registers import Answer, Command, RegisterImage, Request, State, Status

PUBLISH_S = 0.02
TCP_CHANGED_MM = 0.05
TCP_CHANGED_RAD = 2e-4
DRIFT_PICTURES = 3
PICTURE_SHARE = 0.8  # of a request's time, so that the reason arrives before the gate's timeout

log = structlog.get_logger()


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
        self.answer = Answer()
        self.latched: tuple[Status, str] | None = None
        self._basis: Sight | None = None
        self._drifting = 0
        self._work: asyncio.Task[None] | None = None
        measuring.on_sight.append(self._watch)

    async def run(self) -> None:
        """Publish until cancelled."""
        while True:
            self._guard_tcp()
            self.publish()
            await asyncio.sleep(PUBLISH_S)

    def use(self, calibration: Calibration | None, calibration_id: int) -> None:
        """Serve with `calibration` from now on; the present answer is dropped."""
        self.calibration, self.calibration_id = calibration, calibration_id
        self._drifting = 0
        self._settle(Answer(echo=self.answer.echo), None)

    def confirm(self) -> None:
        """Forget a latched fault; ControlError while its cause is still there."""
        trouble = self._tcp_trouble()
        if trouble:
            raise ControlError(f"the cause is still there: {trouble}")
        self.latched, self._drifting = None, 0

    def request(self, request: Request) -> None:
        """Start on a request; one that is being worked on is dropped (latest wins)."""
        if self._work is not None:
            self._work.cancel()
        self._work = asyncio.create_task(self._serve(request))

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
        reading = self.measuring.robot.newest(ROBOT_STALE_S)
        if reading is not None and not reading.running:
            return Status.ROBOT_SAFETY_STOP, "the controller is not in normal mode"
        if self.calibration is None:
            return Status.NOT_CALIBRATED, "activate a calibration: vgrd activate CALIBRATION"
        if self._drifting >= DRIFT_PICTURES:
            return Status.CALIBRATION_DRIFT, "tag A is not where the calibration puts it"
        return None

    def publish(self) -> None:
        """Write the register image: the answer, unless a fault forbids it."""
        fault = self.fault()
        answer = self.answer
        if (fault is not None and answer.status.is_ok) or (
            fault is not None and answer.status is Status.IDLE
        ):
            answer = replace(answer, status=fault[0])
        now = self.clock.monotonic()
        image = RegisterImage(answer, self._state(fault is None), self.measuring.beat, now)
        self.ring.publish(image.pack(), stamp_s=now)

    async def _serve(self, request: Request) -> None:
        if request.command == Command.CLEAR:
            self._settle(Answer(echo=request.trig), None)
            return
        try:
            answer, basis = await self._answer(request)
        except CalibrationError as err:
            log.warning("request_refused", reason=str(err))
            answer, basis = self._refusal(request, Status.CALIBRATION_MISMATCH), None
        self._settle(answer, basis)

    async def _answer(self, request: Request) -> tuple[Answer, Sight | None]:
        fault = self.fault()
        if fault is not None or self.calibration is None:
            status = fault[0] if fault else Status.NOT_CALIBRATED
            return self._refusal(request, status), None
        refusal = check_request(request, self.calibration)
        if refusal is not None:
            return refusal, None
        sight = await self._picture(request)
        if sight is None:
            trouble = self.measuring.camera_trouble()
            status = Status.CAMERA_OFFLINE if trouble else Status.GRAB_TIMEOUT
            return self._refusal(request, status), None
        return self._judge(request, self.calibration, sight), sight

    async def _picture(self, request: Request) -> Sight | None:
        if request.command == Command.EC_NEWEST and self.measuring.sight_of_object is not None:
            return self.measuring.sight_of_object
        if self.measuring.camera_trouble():
            return None
        try:
            timeout_s = request.timeout_s or self.limits.timeout_s
            return await self.measuring.fresh(PICTURE_SHARE * timeout_s)
        except DeviceUnavailable:
            return None

    def _judge(self, request: Request, calibration: Calibration, sight: Sight) -> Answer:
        now, wall = self.clock.monotonic(), self.clock.wall()
        return answer_request(
            request, calibration, self.calibration_id, sight, self.limits, now, wall
        )

    def _refusal(self, request: Request, status: Status) -> Answer:
        return Answer(status=status, echo=request.trig, point=request.point, object=request.object)

    def _settle(self, answer: Answer, basis: Sight | None) -> None:
        self.answer = replace(answer, seq=self.answer.seq + 1)
        self._basis = basis
        if answer.echo and not answer.status.is_ok and answer.status is not Status.IDLE:
            log.warning("answer", status=answer.status.name, point=answer.point)
        self.publish()

    def _watch(self, sight: Sight) -> None:
        """Each new picture may show that the object or the cell moved since the answer."""
        self._watch_drift(sight)
        if self._basis is None or self._basis.tag_b is None or sight.tag_b is None:
            return
        if self.calibration is None or not self.answer.status.is_ok:
            return
        moved = object_displacement_mm(self.calibration, self._basis.tag_b, sight.tag_b)
        if moved > self.limits.moved_mm:
            log.warning("object_moved", moved_mm=round(moved, 3))
            self._settle(replace(self.answer, status=Status.OBJECT_MOVED), None)

    def _watch_drift(self, sight: Sight) -> None:
        calibration = self.calibration
        if calibration is None or calibration.wrist_from_tag_a is None:
            return
        if sight.base_from_wrist is None or sight.tag_a is None:
            return
        by_camera = calibration.base_from_camera.compose(sight.tag_a.camera_from_tag)
        by_robot = sight.base_from_wrist.compose(calibration.wrist_from_tag_a)
        drift_mm, _ = by_camera.distance(by_robot)
        self._drifting = self._drifting + 1 if drift_mm > self.drift_mm else 0

    def _guard_tcp(self) -> None:
        trouble = self._tcp_trouble()
        if trouble and self.latched is None:
            log.error("tcp_changed", reason=trouble)
            self.latched = (Status.TCP_OFFSET_CHANGED, trouble)

    def _tcp_trouble(self) -> str:
        reading = self.measuring.robot.newest(ROBOT_STALE_S)
        if self.calibration is None or reading is None:
            return ""
        return tcp_difference(self.calibration.facts.wrist_from_tcp, reading.wrist_from_tcp)

    def _state(self, ready: bool) -> State:
        reading = self.measuring.robot.newest(ROBOT_STALE_S)
        sight = self.measuring.sight
        state = State(0)
        for flag, holds in (
            (State.READY, ready),
            (State.CAMERA_OK, not self.measuring.camera_trouble()),
            (State.ROBOT_OK, reading is not None),
            (State.CALIBRATED, self.calibration is not None),
            (State.AT_REST, sight is not None and sight.base_from_wrist is not None),
            (State.TAG_A_SEEN, sight is not None and sight.tag_a is not None),
            (State.TAG_B_SEEN, sight is not None and sight.tag_b is not None),
            (State.SIMULATION, self.simulation),
        ):
            state |= flag if holds else State(0)
        return state


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
