"""Touches by foot, through the real daemon: a pedal on a serial port, and an input of the robot."""

import os
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S, Operator
from fakes.controllers.serial_line import SerialLine
from fakes.testing import free_port
from fakes.world.cells import CELLS, DEFAULT
from fakes.world.poses import touch_pose
from vgrd.store.sessions import load_recording

pytestmark = pytest.mark.system

COMES_WITHIN_S = 120.0
INPUT = 2


def test_a_pedal_and_an_input_of_the_robot_record_the_touches_one_after_the_other(
    tmp_path: Path,
) -> None:
    world = CELLS[DEFAULT].world(3, SPEED_MM_S, TURN_RAD_S, perfect=True)
    with ExitStack() as stack:
        foot, port = stack.enter_context(SerialLine()).ends
        cell = stack.enter_context(FakeCell(world, tmp_path, free_port()))
        with cell.cell_file.open("a", encoding="utf-8") as file:
            file.write(
                f'\n[pedal]\ndriver = "serial_pedal"\nrobot_input = {INPUT}\n'
                f'[pedal.settings]\nserial_port = "{port}"\n'
            )
        daemon = stack.enter_context(Daemon(cell.cell_file, tmp_path / "vgrd.log"))
        daemon.wait_until(lambda status: "ok" in str(dict(status["processes"]).get("pedal")))
        operator = Operator(world, daemon.control, world.seed)

        def tread() -> None:
            end = os.open(foot, os.O_WRONLY | os.O_NOCTTY)
            os.write(end, b"1")
            os.close(end)

        def switch() -> None:
            cell.digital_inputs = 1 << INPUT

        operator.press("record.start", plan="joint", session="by-foot")
        poses = []
        for name, press in (("P1", tread), ("P2", switch)):
            poses.append(touch_pose(world.layout, name))
            operator.jog(poses[-1])
            time.sleep(0.2)
            press()
            sample = f"{name}: sample {len(poses)}"
            daemon.wait_until(
                lambda status, s=sample: status["pedal"]["last"] == s, COMES_WITHIN_S
            )
        operator.press("verify", target="P2")
        operator.press("record.stop")
    recording = load_recording(tmp_path / "state" / "sessions" / "by-foot")
    assert [touch.target for touch in recording.touches] == ["P1", "P2"]
    for touch, pose in zip(recording.touches, poses, strict=True):
        mm, rad = touch.base_from_wrist.distance(pose)
        assert mm < 0.01
        assert rad < 1e-4
        assert touch.observation is not None
