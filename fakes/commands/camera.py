"""A fake GigE Vision camera on its own, or showing the world of a fake cell."""

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from fakes.camera.gige_camera import GigeCamera
from fakes.camera.scene import pictures
from fakes.commands.console import Action, numbers, switch, until_stopped, what_can_be_typed
from fakes.world.cells import CELL_HELP, DEFAULT, cell_called
from fakes.world.layout import Layout


def _actions(camera: GigeCamera) -> dict[str, Action]:
    faults = camera.faults
    return {
        "freeze on|off": lambda words: setattr(faults, "freeze", switch(words)),
        "lost SHARE": lambda words: setattr(faults, "lost", numbers(words, 1)[0]),
        "resend on|off": lambda words: setattr(faults, "resend", switch(words)),
        "repeat on|off": lambda words: setattr(faults, "repeat", switch(words)),
    }


async def _serve(host: str, snapshots: Path | None, layout: Layout) -> None:
    with GigeCamera(pictures(snapshots, layout), host, layout.optics.size_px) as camera:
        actions = _actions(camera)
        ready = f"GigE Vision camera at {host}; type: {what_can_be_typed(actions)}"
        await until_stopped(ready, actions)


def main(
    host: Annotated[str, typer.Option(help="address to listen at, 127.x.y.z")] = "127.0.0.3",
    snapshots: Annotated[Path | None, typer.Option(help="ring of a fake world")] = None,
    cell: Annotated[str, typer.Option(help=CELL_HELP)] = DEFAULT,
) -> None:
    """Fake 12 MP GigE Vision camera until Ctrl-C: one picture per software trigger.

    Without a ring it looks at a cell in which nothing moves. Type at it: freeze, resend and repeat
    with on or off, lost with a share of packets.
    """
    asyncio.run(_serve(host, snapshots, cell_called(cell).layout()))
