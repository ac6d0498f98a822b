"""A fake cell that stays: registers to develop a robot program against, without any hardware."""

import asyncio
import contextlib
import math
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S, Operator
from fakes.cell.playground import Playground
from fakes.commands.console import Action, numbers, until_stopped, what_can_be_typed, word
from fakes.commands.demo import set_up_table
from fakes.demo.show import Show
from fakes.world.cells import CELL_HELP, DEFAULT, cell_called
from fakes.world.poses import retracted_pose
from fakes.world.world import World
from vgrd.geometry import Pose


def main(
    port: Annotated[
        int, typer.Option(help="of the registers on 127.0.0.1")
    ] = 1502,  # as in the cell file
    seed: Annotated[int, typer.Option(help="of noise, arm and scripted operator")] = 1,
    folder: Annotated[
        Path | None, typer.Option(help="where state stays from one run to the next")
    ] = None,
    camera: Annotated[str | None, typer.Option(help="aravis or fakes.camera.pylon_camera")] = None,
    cell: Annotated[str, typer.Option(help=CELL_HELP)] = DEFAULT,
    page: Annotated[
        int | None,
        typer.Option(help="port of the operator's page; the next one moves arm and table"),
    ] = None,
    *,
    untaught: Annotated[
        bool, typer.Option(help="teach nothing: a person does, with the page")
    ] = False,
) -> None:
    """Run fake robot, fake camera and the daemon with an active calibration until Ctrl-C.

    The first run teaches the cell. Lines typed here act on the world: turn DEGREES, cover a|b|none,
    flange and tcp with x y z (mm) and a rotation vector (rad), camera the same in its own frame (a
    knock; zeros put it back), slip X Y RAD (tag B on the object), miss TARGET.
    """
    console, kind = Console(), cell_called(cell)
    world = kind.world(seed, SPEED_MM_S, TURN_RAD_S)
    place = folder or Path("build") / (
        "fake-cell" if kind.name == DEFAULT else f"fake-cell-{kind.name}"
    )
    with contextlib.ExitStack() as stack:
        fake = stack.enter_context(FakeCell(world, place, port, camera, kind, page=page))
        console.print(set_up_table(world, fake))
        daemon = stack.enter_context(Daemon(fake.cell_file, place / "vgrd.log"))
        if not untaught:
            _teach_once(console, fake, daemon)
        world.move_flange(retracted_pose(world.layout), time.monotonic())
        console.print(f"registers on 127.0.0.1:{port}, map in docs/registers.md")
        console.print(f"vgrd status --config {fake.cell_file}")
        if page is not None:
            stack.enter_context(Playground(world, page + 1))
            console.print(f"operator's page: http://127.0.0.1:{page}")
            console.print(f"to move arm and table: http://127.0.0.1:{page + 1}")
        actions = world_actions(world)
        ready = f"type: {what_can_be_typed(actions)}; Ctrl-C ends"
        asyncio.run(until_stopped(ready, actions))


def _teach_once(console: Console, fake: FakeCell, daemon: Daemon) -> None:
    status = daemon.control.call("status")
    if status["calibration"] is not None:
        console.print(f"calibration {status['calibration']} of an earlier run is active")
        return
    operator = Operator(fake.world, daemon.control, fake.world.seed)
    show = Show(fake, operator, daemon, console)
    show.teach(time.strftime("teaching-%Y%m%d-%H%M%S"))
    show.calibrate()


def world_actions(world: World) -> dict[str, Action]:
    """What can be done to the world by typing."""

    def turn(words: list[float]) -> None:
        world.turn_table(math.radians(words[0]), time.monotonic())

    def flange(words: list[float]) -> None:
        world.move_flange(Pose.from_rotvec(words[3:], words[:3]), time.monotonic())

    def tcp(words: list[float]) -> None:
        world.arm.wrist_from_tcp = Pose.from_rotvec(words[3:], words[:3])

    def cover(name: str) -> None:
        if name == "none":
            world.cover()
        else:
            world.cover("a" if name == "a" else "b")

    def miss(name: str) -> None:
        miss_mm = world.miss(name, time.monotonic())
        print(f"true tip minus {name}: {miss_mm.round(3).tolist()} mm", flush=True)

    return {
        "turn DEGREES": lambda words: turn(numbers(words, 1)),
        "flange X Y Z RX RY RZ": lambda words: flange(numbers(words, 6)),
        "tcp X Y Z RX RY RZ": lambda words: tcp(numbers(words, 6)),
        "camera X Y Z RX RY RZ": lambda words: world.shift_camera(tuple(numbers(words, 6))),
        "slip X Y RAD": lambda words: world.shift_tag_b(*numbers(words, 3)),
        "cover a|b|none": lambda words: cover(word(words, "a", "b", "none")),
        "miss TARGET": lambda words: miss(word(words, *world.targets)),
    }
