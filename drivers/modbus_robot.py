"""Robots that show their pose in registers of their own Modbus server, TCP or RTU, read by a profile.

Such registers carry no time. A reading is stamped with the middle of the request less half of the
robot's refresh period; it is right only while the robot stands still. Where pose and TCP need two
requests, the pose is read again after the TCP, and both poses must be equal.
"""

import logging

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException

from drivers import robot_profile
from drivers import settings as driver_settings
from drivers.catalogue import ModbusSettings
from drivers.robot_profile import RegisterRange, RobotProfile
from vgrd.clock import Clock
from vgrd.devices import FlangeReading, Robot, Settings
from vgrd.errors import BadReading, DeviceError, DeviceRefused, DeviceUnavailable
from vgrd.geometry import Pose

_SHORTEST_PERIOD_S = 0.01  # chosen: 100 readings a second, where a profile names no refresh
_SHORTEST_WAIT_S = 0.001  # chosen: a time limit of 0 would not wait at all
_READ_HOLDING_REGISTERS = 3  # Modbus function code; the other one is 4, input registers
_SOURCE = "settings of driver modbus_robot"


def open(settings: Settings, clock: Clock) -> Robot:  # noqa: A001 - the name of every driver's entry
    """Connect and read once; settings as in `ModbusSettings`.

    Raises ConfigError, DeviceUnavailable (nobody there, silent), DeviceRefused (the robot has no
    such registers).
    """
    options = driver_settings.parse(ModbusSettings, settings, _SOURCE)
    profile = robot_profile.load(options.profile)
    offset = _given_offset(options)
    # The errors of pymodbus are raised; its log would repeat them on every retry of the daemon.
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    robot = ModbusRobot(profile, options, offset, clock)
    try:
        robot.read_flange(options.timeout_s)
    except BadReading as error:
        robot.close()
        raise DeviceRefused(f"{error}; is {options.profile} the right profile?") from error
    except DeviceError:
        robot.close()
        raise
    return robot


def _given_offset(options: ModbusSettings) -> Pose | None:
    values = options.tcp_offset
    return None if values is None else Pose.from_rotvec(values[3:], values[:3])


def _client(
    profile: RobotProfile, options: ModbusSettings
) -> tuple[ModbusTcpClient | ModbusSerialClient, str]:
    """A client that is not connected yet, and where to."""
    if options.serial_port is not None:
        line = ModbusSerialClient(
            options.serial_port,
            baudrate=options.baud,
            parity=options.parity,
            timeout=options.timeout_s,
            retries=0,
        )
        return line, options.serial_port
    port = profile.port if options.port is None else options.port
    network = ModbusTcpClient(options.host or "", port=port, timeout=options.timeout_s, retries=0)
    return network, f"{options.host}:{port}"


class ModbusRobot:
    """A connected robot; see `open`."""

    def __init__(
        self, profile: RobotProfile, options: ModbusSettings, offset: Pose | None, clock: Clock
    ) -> None:
        self._profile = profile
        self._unit = profile.unit if options.unit is None else options.unit
        self._offset = offset
        self._clock = clock
        self._client: ModbusTcpClient | ModbusSerialClient | None
        self._client, place = _client(profile, options)
        self._where = f"{profile.name} at {place}"
        self._period_s = max(_SHORTEST_PERIOD_S, profile.update_period_s)
        self._next_s = clock.monotonic()
        if not self._client.connect():
            raise DeviceUnavailable(f"cannot connect to {self._where}; is its Modbus server on?")

    def read_flange(self, timeout_s: float) -> FlangeReading:
        """Read the registers, not before a refresh period after the last call.

        As `vgrd.devices.Robot.read_flange`; controller_s is the cell clock.
        """
        deadline_s = self._clock.monotonic() + timeout_s
        self._clock.sleep(max(0.0, min(self._next_s, deadline_s) - self._clock.monotonic()))
        sent_s = self._clock.monotonic()
        self._next_s = sent_s + self._period_s
        pose, shown_tcp = self._profile.decode(self._registers(deadline_s))
        stamp_s = 0.5 * (sent_s + self._clock.monotonic() - self._profile.update_period_s)
        wrist_from_tcp = shown_tcp if shown_tcp is not None else self._offset
        step_mm, step_rad = self._profile.flange_steps(wrist_from_tcp)
        return FlangeReading(
            base_from_wrist=self._flange(pose, wrist_from_tcp),
            wrist_from_tcp=wrist_from_tcp,
            stamp_s=stamp_s,
            controller_s=stamp_s,
            step_mm=step_mm,
            step_rad=step_rad,
        )

    def _flange(self, pose: Pose, wrist_from_tcp: Pose | None) -> Pose:
        """The flange of a pose in the profile's frame."""
        if self._profile.frame == "tcp" and wrist_from_tcp is not None:
            return pose @ wrist_from_tcp.inverse()
        return pose

    def _registers(self, deadline_s: float) -> dict[int, int]:
        """Values by address, of one moment."""
        first, *others = self._profile.blocks
        pose = self._read(first, deadline_s)
        registers = dict(pose)
        for block in others:
            registers |= self._read(block, deadline_s)
        if others and self._read(first, deadline_s) != pose:
            raise BadReading(f"{self._where} moved while it was read")
        return registers

    def _read(self, block: RegisterRange, deadline_s: float) -> dict[int, int]:
        client = self._client
        if client is None:
            raise DeviceUnavailable("the driver was closed")
        client.comm_params.timeout_connect = max(
            _SHORTEST_WAIT_S, deadline_s - self._clock.monotonic()
        )
        read = (
            client.read_holding_registers
            if self._profile.function == _READ_HOLDING_REGISTERS
            else client.read_input_registers
        )
        try:
            reply = read(block.address, count=block.count, device_id=self._unit)
        except (ModbusException, OSError) as error:
            raise DeviceUnavailable(f"{self._where} does not answer: {error}") from error
        if reply.isError() or len(reply.registers) != block.count:
            raise BadReading(
                f"{self._where} refuses to read {block.count} registers at {block.address}: {reply}"
            )
        return dict(zip(range(block.address, block.end), reply.registers, strict=True))

    def close(self) -> None:
        """Release the connection; may be called more than once."""
        client, self._client = self._client, None
        if client is not None:
            client.close()  # type: ignore[no-untyped-call]
