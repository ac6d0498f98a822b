"""A fake cell that was taught before its daemon starts: for tests of everything that comes after teaching."""

import contextlib
import time
from pathlib import Path
from typing import Self

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon, has_devices
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S, Operator
from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.cell.robot_link import RobotLink
from fakes.controllers.robot_program import RobotProgram
from fakes.controllers.rtde import RtdeFaults, RtdeServer
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.world import World
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import ControlError
from vgrd.store.calibrations import CalibrationStore

SEED = 1
LINK_TIMEOUT_S = 60.0  # a test judges how long an answer of the gate took; it does not hang up


def rehearse(folder: Path) -> Calibration:
    """Teach and solve the cell of `TaughtCell` without processes; a few seconds of computing."""
    world = World(Layout(), SEED)
    return calibrate_system(Rehearsal(world, facts_of(world, folder)).teach(spins=6, points=0))


class TaughtCell:
    """A `FakeCell` in `folder` with an active calibration; the daemon is started apart.

    robot: how its arm is read, None by RTDE.
    """

    def __init__(
        self, folder: Path, calibration: Calibration, robot: RobotLink | None = None
    ) -> None:
        self.folder = folder
        self.state = folder / "state"
        self.port = free_port()
        self.world = World(Layout(), SEED, speed_mm_s=SPEED_MM_S, turn_rad_s=TURN_RAD_S)
        self.wrist_from_tcp = self.world.arm.wrist_from_tcp
        self.fake = FakeCell(self.world, folder, self.port, robot=robot)
        store = CalibrationStore(self.state)
        self.calibration = store.save(calibration)
        store.activate(self.calibration, by="rehearsal")

    def __enter__(self) -> Self:
        self.fake.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.fake.__exit__()

    def daemon(self) -> Daemon:
        """The daemon of this cell, not started yet; `with` waits until it serves."""
        return Daemon(
            self.fake.cell_file, self.folder / "vgrd.log", lambda status: bool(status["serving"])
        )

    def program(self) -> RobotProgram:
        """A robot program, not connected yet."""
        return RobotProgram(self.world, "127.0.0.1", self.port, LINK_TIMEOUT_S)

    def operator(self, daemon: Daemon) -> Operator:
        """Somebody who teaches this cell."""
        return Operator(self.world, daemon.control, SEED)

    def restore(self, daemon: Daemon) -> None:
        """Undo what a test did to the world, and wait until the daemon serves as at its start."""

        def faultless(controller: RtdeServer) -> None:
            controller.faults = RtdeFaults()

        self.fake.disturb(faultless)
        self.fake.plug_camera()
        self.world.cover()
        self.world.arm.wrist_from_tcp = self.wrist_from_tcp
        now = time.monotonic()
        arrival = self.world.move_flange(retracted_pose(self.world.layout), now)
        arrival = max(arrival, self.world.turn_table(0.0, now))
        daemon.wait_until(has_devices)
        with contextlib.suppress(ControlError):
            daemon.call("record.stop")
        daemon.confirm()
        time.sleep(max(0.0, arrival - time.monotonic()) + 0.1)
        daemon.wait_until(lambda status: bool(status["serving"] and status["tag_b_seen"]))
