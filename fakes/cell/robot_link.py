"""How the daemon reads a fake arm: RTDE, or a robot profile's registers over TCP or a serial line."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from drivers import robot_profile
from fakes.controllers.modbus_robot import ModbusRobotServer
from fakes.controllers.rtde import PORT as RTDE_PORT
from fakes.controllers.rtde import RtdeServer, RtdeState
from fakes.controllers.serial_line import BAUD
from fakes.testing import free_loopback, free_port
from fakes.world.cells import RTDE
from vgrd.geometry import Pose

StateSource = Callable[[float], RtdeState]
Setting = str | int | list[float]


class Driver(NamedTuple):
    """A driver as a cell file names it, with its settings."""

    name: str
    settings: Mapping[str, Setting]

    @property
    def id(self) -> str:
        """Of the fake robot that is read so."""
        return "fake-ur" if self.name == "ur_rtde" else f"fake-{self.settings['profile']}"


@dataclass(frozen=True, slots=True)
class RobotLink:
    """One end of the link: where the controller listens.

    protocol: `RTDE` or the name of a profile. serial: paths of the two ends of a serial line,
    the controller's first; None for TCP.
    """

    protocol: str
    host: str
    port: int
    serial: tuple[str, str] | None = None

    @classmethod
    def free(cls, protocol: str, serial: tuple[str, str] | None = None) -> "RobotLink":
        """A link with an address of its own."""
        host = free_loopback(RTDE_PORT)
        port = RTDE_PORT if protocol == RTDE else free_port(host)
        return cls(protocol, host, port, serial)

    @property
    def tells_tcp(self) -> bool:
        """Whether the daemon learns which TCP is active on the pendant."""
        if self.protocol == RTDE:
            return True
        return robot_profile.load(self.protocol).tcp_block is not None

    def driver(self, wrist_from_tcp: Pose) -> Driver:
        """What the cell file says; wrist_from_tcp: active on the pendant, told where the robot does not."""
        if self.protocol == RTDE:
            return Driver("ur_rtde", {"host": self.host})
        settings: dict[str, Setting] = {"profile": self.protocol}
        if self.serial is None:
            settings |= {"host": self.host, "port": self.port}
        else:
            settings |= {"serial_port": self.serial[1], "baud": BAUD}
        if not self.tells_tcp:
            offset = (*wrist_from_tcp.translation, *wrist_from_tcp.rotvec())
            settings["tcp_offset"] = [float(number) for number in offset]
        return Driver("modbus_robot", settings)

    def controller(self, state_source: StateSource) -> RtdeServer | ModbusRobotServer:
        """The controller, not started yet."""
        if self.protocol == RTDE:
            return RtdeServer(state_source, self.host)
        profile = robot_profile.load(self.protocol)
        line = None if self.serial is None else self.serial[0]
        return ModbusRobotServer(state_source, profile, self.host, self.port, line)

    def __str__(self) -> str:
        name = "RTDE" if self.protocol == RTDE else f"Modbus registers of {self.protocol}"
        return f"{name} at {self.host}:{self.port}" if self.serial is None else f"{name}, RTU"
