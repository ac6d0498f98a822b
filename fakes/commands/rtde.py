"""A fake UR controller on its own, holding a pose or moving gently."""

import asyncio
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated

import numpy as np
import typer

from fakes.console import Action, numbers, switch, until_stopped, word
from fakes.rtde import PORT, RtdeFaults, RtdeServer, RtdeState
from vgrd.geometry import Pose

_PERIOD_S = 10.0


@dataclass(slots=True)
class Arm:
    """A flange that stands still, or circles horizontally with `radius_mm` in ten seconds."""

    radius_mm: float = 0.0
    base_from_wrist: Pose = field(
        default_factory=lambda: Pose.from_rotvec((0.0, math.pi, 0.0), (400.0, -100.0, 350.0))
    )
    wrist_from_tcp: Pose = field(
        default_factory=lambda: Pose.from_rotvec((0.0, 0.0, 0.4), (12.0, -3.0, 152.0))
    )
    digital_inputs: int = 0

    def state(self, now_s: float) -> RtdeState:
        """State at a time of the monotonic clock."""
        rate = 2.0 * math.pi / _PERIOD_S
        sine, cosine = math.sin(rate * now_s), math.cos(rate * now_s)
        shift = self.radius_mm * np.array((cosine, sine, 0.0))
        wrist = self.base_from_wrist
        return RtdeState(
            Pose(wrist.rotation, wrist.translation + shift),
            self.wrist_from_tcp,
            (-self.radius_mm * rate * sine, self.radius_mm * rate * cosine, 0.0, 0.0, 0.0, 0.0),
            self.digital_inputs,
        )

    def place(self, words: list[float]) -> None:
        """Put the flange at x y z (mm) and rotation vector (rad) in the base."""
        self.base_from_wrist = Pose.from_rotvec(words[3:], words[:3])

    def mount(self, words: list[float]) -> None:
        """Make another TCP active: x y z (mm) and rotation vector (rad) in the flange."""
        self.wrist_from_tcp = Pose.from_rotvec(words[3:], words[:3])


def _actions(arm: Arm, server: RtdeServer) -> dict[str, Action]:
    switches = {
        "silent": "silent",
        "freeze": "freeze",
        "protective-stop": "protective_stop",
        "repeat": "repeat",
        "nan": "not_a_number",
    }
    flags: dict[str, Action] = {
        name: lambda words, attribute=attribute: setattr(server.faults, attribute, switch(words))  # type: ignore[misc]
        for name, attribute in switches.items()
    }
    start = replace(arm)

    def reset(_: Sequence[str]) -> None:
        server.faults = RtdeFaults()
        for item in fields(arm):
            setattr(arm, item.name, getattr(start, item.name))

    return flags | {
        "reset": reset,
        "pose": lambda words: arm.place(numbers(words, 6)),
        "tcp": lambda words: arm.mount(numbers(words, 6)),
        "circle": lambda words: setattr(arm, "radius_mm", numbers(words, 1)[0]),
        "inputs": lambda words: setattr(arm, "digital_inputs", int(numbers(words, 1)[0])),
        "late": lambda words: setattr(server.faults, "late_s", numbers(words, 1)[0]),
        "clock": lambda words: setattr(server.faults, "clock_s", numbers(words, 1)[0]),
        "drop": lambda words: server.drop(reset=word(words, "fin", "rst") == "rst"),
        "text": lambda words: server.send_text(" ".join(words)),
        "missing": lambda words: setattr(server.faults, "missing", frozenset(words)),
    }


async def _serve(arm: Arm, host: str, port: int, *, silent: bool) -> None:
    async with RtdeServer(arm.state, host, port) as server:
        server.faults.silent = silent
        actions = _actions(arm, server)
        ready = f"RTDE controller at {host}:{port}; type: {', '.join(sorted(actions))}"
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
    asyncio.run(_serve(Arm(circle_mm), host, port, silent=silent))
