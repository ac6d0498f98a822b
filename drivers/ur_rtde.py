"""Universal Robots through ur-rtde, with the TCP offset from an RTDE session of our own.

ur-rtde cannot read `tcp_offset`, holds the GIL without a time limit while it connects, and its
getters repeat the last sample for ever once the link is lost. So our session shakes hands first,
with time limits; freshness is the advance of the controller's time; and a pose counts only when
the offset was the same before and after it. Nothing here ever calls `reconnect()`: a failed one
aborts the process at deletion.
"""

import math
from collections.abc import Sequence
from typing import Any

import rtde_receive

from drivers import settings as driver_settings
from drivers.catalogue import UrSettings
from drivers.rtde_session import OffsetTrack, RtdeConnection
from vgrd.clock import Clock
from vgrd.devices import FlangeReading, Robot, Settings
from vgrd.errors import BadReading, DeviceUnavailable
from vgrd.geometry import Pose

_STATUS = ("robot_mode", "safety_status_bits", "actual_digital_input_bits")
_RUNNING = 7  # robot_mode, UR's RTDE guide: RUNNING
_NORMAL_OR_REDUCED = 0b11  # safety_status_bits: normal mode, reduced mode; nothing else may be set
_POSE_NUMBERS = 6  # VECTOR6D of UR's RTDE guide: x y z and a rotation vector
_ROUNDING_RAD = 1e-9  # of a full turn in doubles


def open(settings: Settings, clock: Clock) -> Robot:  # noqa: A001 - the name of every driver's entry
    """Connect to a controller; settings as in `UrSettings`.

    Raises ConfigError, DeviceUnavailable (nobody there, silent, no data), DeviceRefused (old
    PolyScope).
    """
    options = driver_settings.parse(UrSettings, settings, "settings of driver ur_rtde")
    connection = RtdeConnection(
        options.host, options.frequency_hz, options.timeout_s, clock, _STATUS
    )
    track = OffsetTrack(connection)
    try:
        return UrRobot(_receiver(options, track), track, options.host, clock)
    except DeviceUnavailable:
        track.close()
        raise


def _receiver(options: UrSettings, track: OffsetTrack) -> object:
    """Return a connected RTDEReceiveInterface; only of a controller whose data are flowing."""
    if not track.wait_next(options.timeout_s):
        raise DeviceUnavailable(f"the UR controller at {options.host} sends no data")
    names = ["timestamp", "actual_TCP_pose", *_STATUS]
    try:
        return rtde_receive.RTDEReceiveInterface(options.host, options.frequency_hz, names)
    except RuntimeError as error:
        raise DeviceUnavailable(f"ur-rtde cannot connect to {options.host}: {error}") from error


class UrRobot:
    """A connected controller; see `open`."""

    def __init__(self, receiver: object, track: OffsetTrack, host: str, clock: Clock) -> None:
        self._receiver: Any = receiver
        self._track = track
        self._host = host
        self._clock = clock
        self._last_s = -math.inf

    def read_flange(self, timeout_s: float) -> FlangeReading:
        """Block for a newer sample; as `vgrd.devices.Robot.read_flange`."""
        deadline_s = self._clock.monotonic() + timeout_s
        controller_s, tcp = self._newer(deadline_s)
        previous_s, self._last_s = self._last_s, controller_s
        if controller_s < previous_s:
            raise BadReading(
                f"the controller's clock went back from {previous_s:.3f} s to {controller_s:.3f} s"
            )
        base_from_tcp = pose_from_wire(tcp)
        running, inputs = self._running(), int(self._receiver.getActualDigitalInputBits())
        offset = self._offset(controller_s, tcp, max(0.0, deadline_s - self._clock.monotonic()))
        wrist_from_tcp = pose_from_wire(offset)
        return FlangeReading(
            base_from_wrist=base_from_tcp @ wrist_from_tcp.inverse(),
            wrist_from_tcp=wrist_from_tcp,
            stamp_s=self._track.cell_s(controller_s),
            controller_s=controller_s,
            digital_inputs=inputs,
            running=running,
        )

    def _newer(self, deadline_s: float) -> tuple[float, Sequence[float]]:
        """Return controller time and TCP pose (wire units) of a sample other than the last one."""
        while self._receiver is not None:
            controller_s = self._receiver.getTimestamp()
            tcp = self._receiver.getActualTCPPose()
            is_unbroken = self._receiver.getTimestamp() == controller_s
            if is_unbroken and controller_s != self._last_s and len(tcp) == _POSE_NUMBERS:
                return controller_s, tcp
            wait_s = deadline_s - self._clock.monotonic()
            if wait_s <= 0.0:
                raise DeviceUnavailable(f"no new data from the UR controller at {self._host}")
            self._track.wait_next(wait_s)
        raise DeviceUnavailable("the driver was closed")

    def _offset(
        self, controller_s: float, tcp: Sequence[float], timeout_s: float
    ) -> Sequence[float]:
        """TCP offset that holds around `controller_s`, or BadReading."""
        around = self._track.around(controller_s, timeout_s)
        if len({sample.tcp_offset for sample in around}) > 1:
            raise BadReading("the active TCP changed during this sample")
        if any(s.tcp_pose != tuple(tcp) for s in around if s.controller_s == controller_s):
            raise BadReading("ur-rtde and the controller's own stream disagree about the TCP pose")
        return around[0].tcp_offset

    def _running(self) -> bool:
        mode, safety = (
            int(self._receiver.getRobotMode()),
            int(self._receiver.getSafetyStatusBits()),
        )
        return mode == _RUNNING and 0 < safety <= _NORMAL_OR_REDUCED

    def close(self) -> None:
        """Release both connections (half a second in ur-rtde); may be called more than once."""
        self._track.close()
        self._receiver = None


def pose_from_wire(values: Sequence[float]) -> Pose:
    """Pose (mm) of x y z in m and a rotation vector in rad; BadReading when it cannot be one."""
    if not all(map(math.isfinite, values)):
        raise BadReading(f"not a finite pose from the controller: {list(values)}")
    if math.hypot(*values[3:]) > 2.0 * math.pi + _ROUNDING_RAD:
        raise BadReading(f"rotation vector longer than a full turn: {list(values[3:])}")
    return Pose.from_rotvec(values[3:], [1000.0 * value for value in values[:3]])
