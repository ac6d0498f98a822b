"""Why the cell cannot serve at all: its devices, its calibration, a drift, a changed TCP.

The STATE bits tell the same to a robot program, one by one.
"""

import math
from collections.abc import Callable

import structlog

from vgrd.calibration.adoption import TERM_S, term_unix_s
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.contradiction import words_of
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.serving.answering import links_detail
from vgrd.cell.serving.camera_memory import CameraMemory
from vgrd.clock import Clock
from vgrd.errors import ControlError, InputError, TagNotSeen
from vgrd.geometry import Pose
from vgrd.model import Instant, Link, LinkReport, PictureSeries, SlipEstimate
from vgrd.registers import State, Status

TCP_CHANGED_MM = 0.05  # chosen: a tenth of the u95 (0.5 mm) at which answers are OK_DEGRADED
TCP_CHANGED_RAD = 2e-4  # the same at the end of a tool of 250 mm
DRIFT_PICTURES = 3  # in a row: one picture may err, as many do not

Fault = tuple[Status, str]

log = structlog.get_logger()


class Faults:
    """The calibration that serves, and the faults that forbid to serve.

    absence: why there is no calibration. on_latch: called with each new latched fault, and with
    None when it is confirmed.
    """

    def __init__(self, measuring: Measuring, cameras: CameraMemory, clock: Clock) -> None:
        self.calibration: Calibration | None = None
        self.absence: Fault = (Status.STARTING, "the calibration is being loaded")
        self.on_latch: list[Callable[[Fault | None], None]] = []
        self._measuring = measuring
        self._cameras = cameras
        self._clock = clock
        self._contradictions: list[LinkReport] = []  # of the newest pictures in a row
        self._latched: Fault | None = None
        self._report: LinkReport | None = None  # of the newest picture that told of its links
        self._term_unix_s = self._term_s = math.inf  # of a slip that was taken over
        self._series: PictureSeries | None = None  # of pictures since the calibration is in use

    @property
    def latched(self) -> Fault | None:
        """A fault that stands until a person confirms that its cause is gone."""
        return self._latched

    @latched.setter
    def latched(self, fault: Fault | None) -> None:
        if fault != self._latched:
            self._latched = fault
            for listener in self.on_latch:
                listener(fault)

    @property
    def is_drift_suspected(self) -> bool:
        """Whether the newest picture contradicts the calibration."""
        return bool(self._contradictions)

    @property
    def report(self) -> LinkReport | None:
        """Of the newest picture that told of its links."""
        return self._report

    @property
    def moved_links(self) -> int:
        """DETAIL of CALIBRATION_DRIFT: what may have moved, by the newest picture."""
        return links_detail(self._contradictions[-1].suspects) if self._contradictions else 0

    @property
    def moved_mm(self) -> float:
        """How far the likeliest of them moved."""
        return self._contradictions[-1].size_mm if self._contradictions else 0.0

    @property
    def knock(self) -> str:
        """In words, that the camera was knocked and is followed; empty while it stands as it was taught."""
        report = self._report
        if report is None or not report.knocked or report.taught_from_camera is None:
            return ""
        mm, rad = Pose.identity().distance(report.taught_from_camera)
        return (
            f"the camera stands {mm:.2f} mm, {1e3 * rad:.1f} mrad from where it was taught: tag A is "
            "followed; fasten the camera, and teach anew when you can"
        )

    def current(self) -> Fault | None:
        """The fault that forbids to serve now, None while there is none."""
        if self.latched is not None:
            return self.latched
        if trouble := self._measuring.robot_trouble():
            return Status.ROBOT_OFFLINE, trouble
        reading = self._measuring.reading()
        if reading is not None and not reading.running:
            return Status.ROBOT_SAFETY_STOP, "the controller is not in normal mode"
        if self.calibration is None:
            return self.absence
        if self._is_over():
            return Status.CALIBRATION_DRIFT, (
                "the slip that was taken over was not borne out by a touch in time: touch a target "
                "(vgrd verify TARGET) and activate what comes of it, or teach anew"
            )
        if len(self._contradictions) >= DRIFT_PICTURES:
            return Status.CALIBRATION_DRIFT, words_of(self._contradictions[-1])
        if trouble := self._measuring.camera_trouble():
            return Status.CAMERA_OFFLINE, trouble
        return None

    def use(self, calibration: Calibration | None) -> None:
        """Judge by `calibration` from now on; earlier pictures count no longer as a drift."""
        self.calibration = calibration
        self._contradictions.clear()
        self._report = None
        self._series = None
        self._term_unix_s = self._term_s = math.inf
        if calibration is not None:
            stability = self._cameras.stability
            self._series = calibration.solution.series(calibration.facts, stability)
            self._term_unix_s = term_unix_s(calibration)
            left_s = self._term_unix_s - self._clock.wall()
            if math.isfinite(left_s):
                left_s = min(left_s, TERM_S)  # a clock that was ahead makes no term longer
            self._term_s = self._clock.monotonic() + left_s

    def confirm(self, *, is_adopted: bool = False) -> None:
        """Forget a latched fault; ControlError while its cause is there or cannot be looked for.

        is_adopted: the slip was taken over, so that pictures need not show that it is gone.
        """
        if self.latched and self.calibration is not None and self._measuring.reading() is None:
            trouble = self._measuring.robot_trouble()
            raise ControlError(f"nobody can tell whether the cause is gone: robot: {trouble}")
        trouble = self._tcp_trouble()
        if trouble:
            raise ControlError(f"the cause is still there: {trouble}")
        is_slip = self.latched is not None and self.latched[0] is Status.CALIBRATION_DRIFT
        if (
            is_slip
            and not is_adopted
            and self._series is not None
            and (trouble := self._series.resume())
        ):
            raise ControlError(f"nobody can tell yet that the cause is gone: {trouble}")
        self.latched = None
        self._contradictions.clear()

    def check_tcp(self) -> None:
        """Latch a fault when the active TCP is not the calibrated one."""
        trouble = self._tcp_trouble()
        if trouble and self.latched is None:
            log.error("tcp_changed", reason=trouble)
            self.latched = (Status.TCP_OFFSET_CHANGED, trouble)

    def check_links(self, sight: Sight) -> None:
        """Compare where a whole picture shows the tags with what calibration and robot say.

        One that shows no tag B, or no camera's place, tells nothing.
        """
        self._cameras.see(sight)
        if self._series is None or sight.tag_b is None or not sight.is_whole:
            return
        shows_tag_a = sight.tag_a is not None and sight.base_from_wrist is not None
        instant = Instant(sight.stamp_s, sight.rest_since_s, shows_tag_a)
        try:
            report = self._series.see(sight.tag_b, self._cameras.place(sight), instant)
        except TagNotSeen:
            return
        self._report = report
        if report.lasting and self.latched is None:
            log.error("link_slipped", reason=words_of(report))
            self.latched = (Status.CALIBRATION_DRIFT, words_of(report))
        if report.fits:
            self._contradictions.clear()
        else:
            self._contradictions = [*self._contradictions, report][-DRIFT_PICTURES:]

    def slip(self, link: Link) -> SlipEstimate:
        """How a link slipped; InputError where the pictures do not tell."""
        if self._series is None:
            raise InputError("no calibration serves, so nothing can be taken over")
        return self._series.slip(link)

    def _is_over(self) -> bool:
        """Whether the term of a slip that was taken over has ended, by either clock."""
        now_s, now_unix_s = self._clock.monotonic(), self._clock.wall()
        return now_s >= self._term_s or now_unix_s >= self._term_unix_s

    def _tcp_trouble(self) -> str:
        reading = self._measuring.reading()
        if self.calibration is None or reading is None:
            return ""
        return tcp_difference(self.calibration.facts.wrist_from_tcp, reading.wrist_from_tcp)

    def state(self, *, is_ready: bool, is_held: bool, is_simulation: bool) -> State:
        """The STATE register. is_held: an answer stands although tag B is hidden."""
        reading = self._measuring.reading()
        sight = self._measuring.sight
        state = State(0)
        for flag, holds in (
            (State.READY, is_ready),
            (State.CAMERA_OK, not self._measuring.camera_blind()),
            (State.ROBOT_OK, reading is not None),
            (State.CALIBRATED, self.calibration is not None),
            (State.AT_REST, sight is not None and sight.base_from_wrist is not None),
            (State.TAG_A_SEEN, sight is not None and sight.tag_a is not None),
            (State.TAG_B_SEEN, sight is not None and sight.tag_b is not None and not is_held),
            (State.HELD, is_held),
            (State.SIMULATION, is_simulation),
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
