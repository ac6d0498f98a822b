"""A fake UR controller on its own, holding a pose or moving gently."""

import asyncio
from collections.abc import Sequence
from typing import Annotated

import typer

from fakes.commands.arm import ScriptedArm
from fakes.commands.console import Action, numbers, switch, until_stopped, what_can_be_typed, word
from fakes.controllers.rtde import PORT, RtdeFaults, RtdeServer


def _actions(arm: ScriptedArm, server: RtdeServer) -> dict[str, Action]:
    switches = {
        "silent": "silent",
        "freeze": "freeze",
        "protective-stop": "protective_stop",
        "repeat": "repeat",
        "nan": "not_a_number",
    }
    flags: dict[str, Action] = {
        f"{name} on|off": lambda words, attribute=attribute: setattr(
            server.faults, attribute, switch(words)
        )  # type: ignore[misc]
        for name, attribute in switches.items()
    }
    still = arm.actions()

    def reset(words: Sequence[str]) -> None:
        server.faults = RtdeFaults()
        still["reset"](words)

    return (
        still
        | flags
        | {
            "reset": reset,
            "late SECONDS": lambda words: setattr(server.faults, "late_s", numbers(words, 1)[0]),
            "clock SECONDS": lambda words: setattr(server.faults, "clock_s", numbers(words, 1)[0]),
            "drop fin|rst": lambda words: server.drop(reset=word(words, "fin", "rst") == "rst"),
            "text WORDS": lambda words: server.send_text(" ".join(words)),
            "missing NAMES": lambda words: setattr(server.faults, "missing", frozenset(words)),
        }
    )


async def _serve(arm: ScriptedArm, host: str, port: int, *, silent: bool) -> None:
    async with RtdeServer(arm.state, host, port) as server:
        server.faults.silent = silent
        actions = _actions(arm, server)
        ready = f"RTDE controller at {host}:{port}; type: {what_can_be_typed(actions)}"
        await until_stopped(ready, actions)


def main(
    host: Annotated[str, typer.Option(help="address to listen at, 127.x.y.z")] = "127.0.0.2",
    port: Annotated[int, typer.Option(help="ur-rtde knows only 30004")] = PORT,
    circle_mm: Annotated[float, typer.Option(help="radius of a gentle motion")] = 0.0,
    *,
    silent: Annotated[bool, typer.Option(help="accept and never answer")] = False,
) -> None:
    """Fake UR controller (RTDE) until Ctrl-C; faults and poses are typed at it, a line each.

    pose and tcp take x y z (mm) and a rotation vector (rad); silent, freeze, protective-stop,
    repeat and nan take on or off; late and clock take seconds; drop takes fin or rst;
    reset undoes all.
    """
    asyncio.run(_serve(ScriptedArm(circle_mm), host, port, silent=silent))
