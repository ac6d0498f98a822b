"""The demo: the daemon's whole job on a fake cell, over real protocols, with the true errors at the end."""

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.cell.memory import pss_mib, tree_pss_mib
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S, Operator
from fakes.controllers.robot_program import Stopped
from fakes.demo.comparison import misses_by_method
from fakes.demo.report import Report
from fakes.demo.show import Show
from fakes.testing import free_port
from fakes.world.cells import CELL_HELP, DEFAULT, RTDE, cell_called
from fakes.world.world import World
from vgrd.errors import VgrdError


def main(
    seed: Annotated[int, typer.Option(help="of noise, arm and scripted operator")] = 1,
    requests: Annotated[
        int, typer.Option(help="robot requests at new table angles")
    ] = 30,  # as in the README's table
    folder: Annotated[Path | None, typer.Option(help="where to leave the files")] = None,
    camera: Annotated[str | None, typer.Option(help="aravis or fakes.camera.pylon_camera")] = None,
    cell: Annotated[str, typer.Option(help=CELL_HELP)] = DEFAULT,
    *,
    perfect: Annotated[bool, typer.Option(help="no touch noise, no arm errors")] = False,
    faults: Annotated[bool, typer.Option(help="show the live faults")] = True,
) -> None:
    """Teach, solve, activate and serve on the fake cell; exit 1 when a figure is not reached."""
    console = Console()
    started, kind = time.monotonic(), cell_called(cell)
    robot = "ur-rtde and Modbus" if kind.controller == RTDE else "Modbus on both sides"
    console.print(f"vgrd demo: simulated robot and images; real {robot}", style="bold")
    world = kind.world(seed, SPEED_MM_S, TURN_RAD_S, perfect=perfect)
    place = folder or Path(tempfile.mkdtemp(prefix="demo-", dir=Path.cwd()))
    try:
        good = _perform(
            console,
            FakeCell(world, place, free_port(), camera, kind),
            requests,
            started,
            perfect,
            faults,
        )
    except Stopped as stop:
        console.print(f"the robot program stopped: {stop.reason}", style="bold red")
        good = False
    except VgrdError as error:
        console.print(f"the daemon refused: {error}", style="bold red")
        good = False
    except TimeoutError as error:
        console.print(str(error), style="bold red", markup=False)
        good = False
    sys.exit(0 if good else 1)


def _perform(
    console: Console,
    fake: FakeCell,
    requests: int,
    started: float,
    perfect: bool,
    faults: bool,
) -> bool:
    world, place = fake.world, fake.folder
    with fake as cell:
        console.print(set_up_table(world, cell))
        with Daemon(cell.cell_file, place / "vgrd.log") as daemon:
            operator = Operator(world, daemon.control, world.seed)
            show = Show(cell, operator, daemon, console)
            show.teach("teaching")
            show.calibrate()
            show.requests(requests, world.seed)
            memory = {name: pss_mib(pid) for name, pid in daemon.pids().items()}
            total_mib = tree_pss_mib(os.getpid())
            if faults:
                show.faults()
            stop_s = daemon.stop()
            show.shown.presses = operator.repeats
    sessions = place / "state" / "sessions"
    teaching, asking = sessions / "teaching", sessions / "requests"
    method_misses = misses_by_method(world, teaching, asking, show.shown.requests)
    report = Report(console, show.shown, perfect=perfect)
    report.methods(method_misses)
    report.insertions(method_misses, world.layout)
    calibration = f"{show.shown.calibration['calibration']}.json"
    report.serving(world.layout, place / "state" / "calibrations" / calibration)
    report.tags(operator)
    report.faults()
    report.memory(memory, total_mib)
    report.files(place, stop_s, time.monotonic() - started)
    report.write(place / "demo.json", method_misses)
    return report.good


def set_up_table(world: World, cell: FakeCell) -> Table:
    """Make the table of what is simulated."""
    noise, layout = world.noise, world.layout
    width, height = layout.optics.size_px
    sizes = layout.tag_a.size_mm, layout.tag_b.size_mm
    table = Table("what", "as", title="the fake cell", title_justify="left")
    for row in (
        ("camera", f"{cell.camera} ({cell.camera_reason})"),
        ("picture", f"{width} x {height} px, f {layout.optics.matrix[0, 0]:.0f} px, oblique"),
        ("tags", f"A {sizes[0]} mm at the flange, B {sizes[1]} mm on the object"),
        ("arm's axes", f"{layout.arm_axes}"),
        ("object", f"{len(layout.targets)} holes, {layout.motion.value}"),
        ("plan", cell.kind.plan.value),
        ("controller", f"{cell.robot}, a non-zero TCP active"),
        ("touches", f"sigma {noise.touch_sigma_mm} mm per axis, within {noise.touch_limit_mm}"),
        ("arm", f"repeats to {noise.repeatability_mm} mm, error field to {noise.field_mm} mm"),
        ("intrinsics", "known exactly"),
        ("seed", str(world.seed)),
    ):
        table.add_row(*row)
    return table
