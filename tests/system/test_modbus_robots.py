"""Robots read over Modbus, through the real daemon: taught and served, in every rotation format, by TCP and RTU."""

import math
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers import robot_profile
from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S, Operator
from fakes.cell.robot_link import RobotLink
from fakes.cell.session import ask_until_answered
from fakes.cell.taught import TaughtCell
from fakes.controllers.robot_program import RobotProgram
from fakes.controllers.serial_line import SerialLine
from fakes.testing import free_port
from fakes.world.cells import CELLS
from fakes.world.poses import look_poses, retracted_pose
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.joint import JointSolution
from vgrd.store.sessions import load_recording

pytestmark = pytest.mark.system

# Steps of the registers as the brands document them: mm, and rad of each number of the rotation.
STEPS = {"ur": (0.1, 1e-3), "xarm": (0.1, math.radians(0.1)), "doosan": (0.1, math.radians(0.1))}
FORMATS = {"ur": "rotvec", "xarm": "rotvec-deg", "doosan": "zyz-deg", "jaka": "rpy-fixed-xyz-deg"}
TOUCH_MM = 0.3  # of a calibration from touches of sigma 0.233 mm, and a step of the registers
PERFECT_MM = 0.1  # perfect touches, float32: what is left is the pictures' noise


def test_the_formats_are_all_that_profiles_have() -> None:
    names = sorted(path.stem for path in robot_profile.FOLDER.glob("*.toml"))
    formats = {name: robot_profile.load(name).rotation for name in names}
    assert set(formats.values()) == set(FORMATS.values())
    assert all(formats[name] == rotation for name, rotation in FORMATS.items())


def test_a_jaka_arm_read_over_modbus_is_taught_and_served(tmp_path: Path) -> None:
    """The cell of the paper's experiment A: universal method, a tray that lies anywhere on a plane."""
    kind = CELLS["fruit"]
    world = kind.world(6, SPEED_MM_S, TURN_RAD_S, perfect=True)
    names = list(world.targets)
    with ExitStack() as stack:
        cell = stack.enter_context(FakeCell(world, tmp_path, free_port(), kind=kind))
        daemon = stack.enter_context(Daemon(cell.cell_file, tmp_path / "vgrd.log"))
        operator = Operator(world, daemon.control, world.seed)
        operator.press("record.start", plan=kind.plan.value, session="taught")
        steps = [*operator.looks(5), *operator.touches(names, tilted=False)]
        for step in [*steps, *operator.touches(names[:3], tilted=True)]:
            step()
        operator.press("record.stop")
        solved = daemon.control.call("solve", timeout_s=200.0)
        operator.press("activate", calibration=solved["calibration"], by="test")
        program = stack.enter_context(RobotProgram(world, "127.0.0.1", cell.port))
        for name, angle in (("P2", 1.3), ("P6", 4.4)):
            operator.jog(retracted_pose(world.layout))
            operator.turn(angle)
            reply = ask_until_answered(program, world.targets[name].id)
            miss = world.miss_at(reply.base_from_wrist, name, angle)
            assert np.linalg.norm(miss) < PERFECT_MM


def taught_by(calibration: Calibration, profile: str) -> Calibration:
    """The calibration had a robot of this profile told its poses: in its steps, its TCP's too."""
    step_mm, step_rad = STEPS[profile]
    facts = replace(
        calibration.facts,
        robot_id=f"fake-{profile}",
        wrist_from_tcp=None,
        robot_step_mm=step_mm + 122.0 * step_rad,  # the TCP on the pendant is so far off
        robot_step_rad=step_rad,
    )
    solution = calibration.solution
    assert isinstance(solution, JointSolution)
    told = facts.arm  # its steps; what teaching found of its noise stays
    model = replace(solution.arm.model, quantum_mm=told.quantum_mm, quantum_rad=told.quantum_rad)
    arm = replace(solution.arm, model=model)
    return replace(calibration, facts=facts, solution=replace(solution, arm=arm))


@pytest.mark.parametrize(("profile", "wire"), [("ur", "tcp"), ("xarm", "tcp"), ("doosan", "rtu")])
def test_a_taught_cell_records_and_serves_where_the_arm_is_in_every_format(
    tmp_path: Path, calibration: Calibration, profile: str, wire: str
) -> None:
    with ExitStack() as stack:
        ends = stack.enter_context(SerialLine()).ends if wire == "rtu" else None
        robot = RobotLink.free(profile, ends)
        of_robot = taught_by(calibration, profile)
        cell = stack.enter_context(TaughtCell(tmp_path, of_robot, robot))
        daemon = stack.enter_context(cell.daemon())
        operator, world = cell.operator(daemon), cell.world
        operator.press("record.start", plan="joint", session="poses")
        true = []
        for pose in look_poses(world.layout, 3, seed=9):
            operator.jog(pose)
            operator.press("point", name="anywhere")
            true.append(world.reported_flange(time.monotonic()))
        operator.press("record.stop")
        recording = load_recording(tmp_path / "state" / "sessions" / "poses")
        step_mm, step_rad = STEPS[profile]
        lever_mm = float(np.linalg.norm(world.arm.wrist_from_tcp.translation))
        for touch, pose in zip(recording.points, true, strict=True):
            mm, rad = touch.base_from_wrist.distance(pose)
            assert rad < 2 * step_rad
            assert mm < 2 * step_mm + 2 * lever_mm * step_rad

        operator.jog(retracted_pose(world.layout))
        operator.turn(0.9)
        with cell.program() as program:
            reply = ask_until_answered(program, world.targets["P3"].id)
        miss = world.miss_at(reply.base_from_wrist, "P3", 0.9)
        assert np.linalg.norm(miss) < TOUCH_MM
