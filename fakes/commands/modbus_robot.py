"""A fake robot with a Modbus server on its own, holding a pose or moving gently."""

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


async def _serve(arm: ScriptedArm, profile: str, host: str, port: int) -> None:
    loaded = robot_profile.load(profile)
    async with ModbusRobotServer(arm.state, loaded, host, port) as server:
        actions = _actions(arm, server)
        ready = f"{loaded.name} at {host}:{port}; type: {what_can_be_typed(actions)}"
        await until_stopped(ready, actions)


def main(
    profile: Annotated[str, typer.Option(help="name in config/robots, or a TOML file")] = "ur",
    host: Annotated[str, typer.Option(help="address to listen at")] = "127.0.0.4",
    port: Annotated[
        int, typer.Option(help="Modbus wants 502, which needs privileges")
    ] = 5020,  # this one needs none
    circle_mm: Annotated[float, typer.Option(help="radius of a gentle motion")] = 0.0,
) -> None:
    """Fake robot whose own Modbus server shows its pose, until Ctrl-C; type at it, a line each.

    pose and tcp take x y z (mm) and a rotation vector (rad); silent and refuse take on or off;
    reset undoes all.
    """
    asyncio.run(_serve(ScriptedArm(circle_mm), profile, host, port))
