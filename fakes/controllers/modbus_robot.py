"""A robot's own Modbus server, TCP or RTU, by a profile of `config/robots`, on pymodbus's server."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.robot_profile import RobotProfile
from fakes.controllers.serial_line import BAUD
from vgrd.geometry import Pose


class ArmState(Protocol):
    """What the registers show: the reported flange and the active TCP, mm."""

    @property
    def base_from_wrist(self) -> Pose:
        """The reported flange."""
        ...

    @property
    def wrist_from_tcp(self) -> Pose:
        """The TCP that is active on the pendant."""
        ...


@dataclass(slots=True)
class ModbusFaults:
    """silent: accept requests and never answer; refuse: answer with the exception "busy"."""

    silent: bool = False
    refuse: bool = False


class ModbusRobotServer:
    """A robot at `host:port`; `state_source(now_s)` tells its state at a time of CLOCK_MONOTONIC.

    serial_port: the path of one, where the robot answers instead, by RTU.
    `async with` starts and stops it. Its registers refresh with the profile's period.
    """

    def __init__(
        self,
        state_source: Callable[[float], ArmState],
        profile: RobotProfile,
        host: str,
        port: int,
        serial_port: str | None = None,
    ) -> None:
        self.faults = ModbusFaults()
        self._source = state_source
        self._profile = profile
        self._address = (host, port)
        self._serial_port = serial_port
        self._shown: dict[int, int] = {}
        self._refreshed_s = -1.0

    async def __aenter__(self) -> "ModbusRobotServer":
        device = SimDevice(id=self._profile.unit, simdata=self._space(), action=self._show)
        self._server = (
            ModbusTcpServer(device, address=self._address)
            if self._serial_port is None
            else ModbusSerialServer(device, port=self._serial_port, baudrate=BAUD)
        )
        await self._server.serve_forever(background=True)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._server.shutdown()  # type: ignore[no-untyped-call]

    def _space(self) -> tuple[list[SimData], list[SimData], list[SimData], list[SimData]]:
        """Coils, discrete inputs, holding and input registers: the profile's, and one unused."""
        profile_blocks = [
            SimData(block.address, values=[0] * block.count, datatype=DataType.REGISTERS)
            for block in self._profile.blocks
        ]
        bits = [SimData(0, values=[False], datatype=DataType.BITS)]
        spare_block = [SimData(65535, values=[0], datatype=DataType.REGISTERS)]
        return (
            (bits, bits, profile_blocks, spare_block)
            if self._profile.function == 3
            else (bits, bits, spare_block, profile_blocks)
        )

    async def _show(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        set_values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Put the present state into the registers that are read (pymodbus's `SimAction`)."""
        del function, set_values
        while self.faults.silent:  # noqa: ASYNC110 - switched by hand, no event to wait for
            await asyncio.sleep(0.05)
        if self.faults.refuse:
            return ExcCodes.DEVICE_BUSY
        self._refresh(time.monotonic())
        for register in range(address, address + count):
            registers[register - start] = self._shown.get(register, 0)
        return None

    def _refresh(self, now_s: float) -> None:
        period_s = self._profile.update_period_s
        if now_s - self._refreshed_s >= period_s:
            self._refreshed_s = now_s - now_s % period_s if period_s else now_s
            state = self._source(self._refreshed_s)
            self._shown = self._profile.encode(state.base_from_wrist, state.wrist_from_tcp)
