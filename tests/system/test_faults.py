"""Every live fault of the cell takes the coordinate out of the registers, says why, and heals."""

import math
import time
from collections.abc import Callable, Iterator

import pytest

from fakes.poses import retracted_pose
from fakes.robot_program import Reply, RobotProgram, Stopped
from fakes.rtde import RtdeServer
from fakes.taught import TaughtCell
from vgrd.errors import ControlError
from vgrd.geometry import Pose
from vgrd.registers import State, Status

pytestmark = pytest.mark.system

HEALS_WITHIN_S = 30.0
ROBOT_LOST_WITHIN_S = 3.0
I16_SENTINEL, I32_SENTINEL = -(2**15), -(2**31)


@pytest.fixture
def program(live) -> Iterator[RobotProgram]:
    with live.cell.program() as program:
        yield program


def wait_for(
    program: RobotProgram, *wanted: Status, within_s: float = HEALS_WITHIN_S
) -> dict[str, float]:
    """The first view with one of these statuses."""
    end, values = time.monotonic() + within_s, {}
    while time.monotonic() < end:
        values = program.read()
        if values["STATUS"] in wanted:
            return values
        time.sleep(0.005)
    raise AssertionError(f"still {Status(int(values['STATUS'])).name}")


def ask_until_good(program: RobotProgram, point: int = 1) -> Reply:
    end, reason = time.monotonic() + HEALS_WITHIN_S, ""
    while time.monotonic() < end:
        try:
            return program.ask(point)
        except Stopped as stop:
            reason = stop.reason
            time.sleep(0.05)
    raise AssertionError(f"it does not serve again: {reason}")


def refusal(program: RobotProgram, point: int = 1) -> Status | None:
    """Status with which a request is refused."""
    with pytest.raises(Stopped) as stopped:
        program.ask(point)
    return stopped.value.status


def assert_no_coordinate(values: dict[str, float]) -> None:
    assert not int(values["STATE"]) & State.VALID
    for axis in ("X", "Y", "Z", "RX", "RY", "RZ"):
        assert values[f"EC16_{axis}"] == I16_SENTINEL
        assert values[f"EC32_{axis}"] == I32_SENTINEL
        assert math.isnan(values[f"ECF_{axis}"])


def assert_leads_onto(cell: TaughtCell, reply: Reply, target: str) -> None:
    angle = cell.world.table_angle(time.monotonic())
    miss = cell.world.miss_at(reply.base_from_wrist, target, angle)
    assert float((miss @ miss) ** 0.5) < 1.0


def test_a_table_turned_after_the_answer_invalidates_it(live, program) -> None:
    assert_leads_onto(live.cell, program.ask(1), "P1")
    live.cell.world.turn_table(0.3, time.monotonic())
    assert_no_coordinate(wait_for(program, Status.OBJECT_MOVED))
    live.cell.operator(live.daemon).turn(0.3)
    assert program.read()["STATUS"] == Status.OBJECT_MOVED
    assert_leads_onto(live.cell, ask_until_good(program), "P1")


def test_an_answer_read_late_has_expired_while_its_age_runs_on(program) -> None:
    program.ask(2)
    first = program.read()
    last_good = first
    while (values := program.read())["STATUS"] == Status.OK:
        assert values["AGE"] <= 3000
        last_good = values
        time.sleep(0.02)
    assert values["STATUS"] == Status.IMAGE_TOO_OLD
    assert_no_coordinate(values)
    assert values["ECHO"] == first["ECHO"]
    assert values["AGE"] >= 3000 > last_good["AGE"] > first["AGE"]


def test_a_covered_tag_is_named_until_it_is_free_again(live, program) -> None:
    live.cell.world.cover("b")
    assert refusal(program) is Status.TAG_B_NOT_FOUND
    assert_no_coordinate(program.read())
    live.cell.world.cover()
    assert_leads_onto(live.cell, ask_until_good(program, 3), "P3")


def test_another_tcp_on_the_pendant_stops_everything_until_it_is_confirmed(live, program) -> None:
    program.ask(1)
    arm = live.cell.world.arm
    arm.wrist_from_tcp = live.cell.wrist_from_tcp @ Pose.from_rotvec((0, 0, 0), (0, 0, 5.0))
    assert_no_coordinate(
        wait_for(program, Status.TCP_OFFSET_CHANGED, within_s=ROBOT_LOST_WITHIN_S)
    )
    assert refusal(program) is Status.TCP_OFFSET_CHANGED
    with pytest.raises(ControlError, match="still there"):
        live.daemon.control.call("confirm")
    arm.wrist_from_tcp = live.cell.wrist_from_tcp
    time.sleep(0.5)
    assert refusal(program) is Status.TCP_OFFSET_CHANGED
    live.daemon.control.call("confirm")
    assert_leads_onto(live.cell, ask_until_good(program), "P1")


def freeze(controller: RtdeServer) -> None:
    controller.faults.freeze = True


def drop(controller: RtdeServer) -> None:
    controller.faults.silent = True  # else it would be back before anybody looks
    controller.drop(reset=True)


def fall_silent(controller: RtdeServer) -> None:
    controller.faults.silent = True
    controller.faults.freeze = True


@pytest.mark.parametrize("strike", [freeze, drop, fall_silent])
def test_a_robot_that_is_lost_is_told_at_once_and_comes_back_by_itself(
    live, program, strike: Callable[[RtdeServer], None]
) -> None:
    program.ask(1)
    live.cell.fake.disturb(strike)
    lost = wait_for(program, Status.ROBOT_OFFLINE, within_s=ROBOT_LOST_WITHIN_S)
    assert_no_coordinate(lost)
    assert not int(lost["STATE"]) & (State.ROBOT_OK | State.READY)
    assert refusal(program) is Status.ROBOT_OFFLINE
    status = live.daemon.control.call("status", timeout_s=2.0)
    assert status["robot"] != "ok"
    assert status["camera"] == "ok"
    live.cell.restore(live.daemon)
    assert_leads_onto(live.cell, ask_until_good(program), "P1")


def test_a_controller_that_accepts_and_never_answers_freezes_only_its_own_process(taught) -> None:
    def never_answer(controller: RtdeServer) -> None:
        controller.faults.silent = True

    taught.fake.disturb(never_answer)
    taught.world.move_flange(retracted_pose(), time.monotonic())
    daemon = taught.daemon()
    daemon.good = lambda status: status["camera"] == "ok" and bool(status["tag_b_seen"])
    with daemon, taught.program() as program:
        start = time.monotonic()
        while time.monotonic() < start + 4.0:
            values = program.read()
            assert values["STATUS"] == Status.ROBOT_OFFLINE
            assert int(values["STATE"]) & State.CAMERA_OK
            time.sleep(0.01)
        asked = time.monotonic()
        assert daemon.control.call("status", timeout_s=2.0)["camera"] == "ok"
        assert time.monotonic() - asked < 1.0
        daemon.wait_until(lambda status: "does not answer" in str(status["robot"]))
        taught.restore(daemon)
        assert_leads_onto(taught, ask_until_good(program), "P1")


def test_a_camera_that_is_lost_is_told_and_comes_back_by_itself(live, program) -> None:
    if live.cell.fake.camera != "aravis":
        pytest.skip("only a camera on the network can be unplugged")
    program.ask(1)
    live.cell.fake.unplug_camera()
    live.daemon.wait_until(lambda status: status["camera"] != "ok")
    assert refusal(program) is Status.CAMERA_OFFLINE
    values = program.read()
    assert_no_coordinate(values)
    assert not int(values["STATE"]) & State.CAMERA_OK
    assert int(values["STATE"]) & State.ROBOT_OK
    live.cell.fake.plug_camera()
    assert_leads_onto(live.cell, ask_until_good(program), "P1")
