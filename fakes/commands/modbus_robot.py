"""A fake robot with a Modbus server on its own, TCP or RTU, holding a pose or moving gently."""

import asyncio
from collections.abc import Sequence
from typing import Annotated

import typer

from drivers import robot_profile
from fakes.commands.arm import ScriptedArm
from fakes.commands.console import Action, switch, until_stopped, what_can_be_typed
from fakes.controllers.modbus_robot import ModbusFaults, ModbusRobotServer


def _actions(arm: ScriptedArm, server: ModbusRobotServer) -> dict[str, Action]:
    still = arm.actions()

    def reset(words: Sequence[str]) -> None:
        server.faults = ModbusFaults()
        still["reset"](words)

    return still | {
        "reset": reset,
        "silent on|off": lambda words: setattr(server.faults, "silent", switch(words)),
        "refuse on|off": lambda words: setattr(server.faults, "refuse", switch(words)),
    }


async def _serve(arm: ScriptedArm, server: ModbusRobotServer, name: str) -> None:
    async with server:
        actions = _actions(arm, server)
        ready = f"{name}; type: {what_can_be_typed(actions)}"
        await until_stopped(ready, actions)


def main(
    profile: Annotated[str, typer.Option(help="name in config/robots, or a TOML file")] = "ur",
    host: Annotated[str, typer.Option(help="address to listen at")] = "127.0.0.4",
    port: Annotated[
        int, typer.Option(help="Modbus wants 502, which needs privileges")
    ] = 5020,  # this one needs none
    serial_port: Annotated[
        str | None, typer.Option(help="answer there by Modbus RTU, not on the network")
    ] = None,
    circle_mm: Annotated[float, typer.Option(help="radius of a gentle motion")] = 0.0,
) -> None:
    """Fake robot whose own Modbus server shows its pose, until Ctrl-C; type at it, a line each.

    pose and tcp take x y z (mm) and a rotation vector (rad); silent and refuse take on or off;
    reset undoes all.
    """
    loaded, arm = robot_profile.load(profile), ScriptedArm(circle_mm)
    server = ModbusRobotServer(arm.state, loaded, host, port, serial_port)
    place = f"{host}:{port}" if serial_port is None else serial_port
    asyncio.run(_serve(arm, server, f"{loaded.name} at {place}"))
