"""One contract for every robot driver, each against its fake controller in a process of its own."""

import socket
import time
from dataclasses import dataclass

import numpy as np
import pytest

from drivers import modbus_robot, robot_profile, ur_rtde
from fakes.testing import FakeProcess, free_loopback
from vgrd.clock import SystemClock
from vgrd.devices.stillness import RestLimits, is_covered, rest_pose
from vgrd.errors import BadReading, DeviceUnavailable
from vgrd.geometry import Pose

CLOCK = SystemClock()
TCP = (12.0, -3.0, 152.0, 0.0, 0.0, 0.4)
SHOWS_NO_OFFSET = ("delta",)
PROFILES = ("ur", "techman", "doosan", "delta")


@dataclass
class Cell:
    """A fake controller and the way to open its robot; tolerances: rounding of its registers."""

    process: FakeProcess
    open: object
    mm: float
    rad: float
    tells_tcp: bool


def free_port(host):
    with socket.socket() as probe:
        probe.bind((host, 0))
        return probe.getsockname()[1]


def modbus_cell(name):
    host, profile = free_loopback(30004), robot_profile.load(name)
    port = free_port(host)
    process = FakeProcess("modbus-robot", "--profile", name, "--host", host, "--port", str(port))
    settings = {"host": host, "port": port, "profile": name}
    if name in SHOWS_NO_OFFSET:
        settings["tcp_offset"] = list(TCP)
    rad = 4 * profile.rotation_sigma_rad + 2e-5
    mm = 4 * profile.position_sigma_mm + 160 * rad + 1e-3
    opened = lambda **more: modbus_robot.open(settings | more, CLOCK)  # noqa: E731
    return Cell(process, opened, mm, rad, name not in SHOWS_NO_OFFSET)


def rtde_cell():
    host = free_loopback(30004)
    process = FakeProcess("rtde", "--host", host)
    opened = lambda **more: ur_rtde.open({"host": host} | more, CLOCK)  # noqa: E731
    return Cell(process, opened, 1e-6, 1e-7, tells_tcp=True)


@pytest.fixture(scope="module", params=["ur_rtde", *PROFILES])
def shared(request):
    cell = rtde_cell() if request.param == "ur_rtde" else modbus_cell(request.param)
    with cell.process:
        yield cell


@pytest.fixture
def cell(shared):
    shared.process.type("reset")
    return shared


@pytest.fixture
def robot(cell):
    robot = cell.open()
    yield robot
    robot.close()


def good(robot):
    """Read until a reading is good, at most a second."""
    end = time.monotonic() + 1.0
    while True:
        try:
            return robot.read_flange(0.5)
        except BadReading:
            assert time.monotonic() < end


def test_the_flange_is_reported_whatever_tcp_is_active(cell, robot):
    rng = np.random.default_rng(8)
    for _ in range(2):
        rotvec, position = rng.uniform(-1.5, 1.5, 3), rng.uniform(-600, 600, 3)
        wrist = Pose.from_rotvec(rotvec, position)
        cell.process.type("pose " + " ".join(map(str, (*position, *rotvec))))
        if cell.tells_tcp:
            tcp = (*rng.uniform(-150, 150, 3), *rng.uniform(-1.0, 1.0, 3))
            cell.process.type("tcp " + " ".join(map(str, tcp)))
        for _ in range(6):  # what was on its way, and registers that refresh slowly
            reading = good(robot)
        mm, rad = reading.base_from_wrist.distance(wrist)
        assert mm < cell.mm
        assert rad < cell.rad
        if cell.tells_tcp:
            told = reading.wrist_from_tcp.distance(Pose.from_rotvec(tcp[3:], tcp[:3]))
            assert told[0] < 2 * cell.mm
            assert told[1] < 2 * cell.rad


def test_a_picture_of_a_resting_arm_gets_its_pose_at_the_robots_own_rate(cell, robot):
    cell.process.type("pose 400.05 -120.05 300.05 0.1 0.2 0.3")
    for _ in range(6):  # what was on its way, and registers that refresh slowly
        good(robot)
    readings = [good(robot) for _ in range(4)]
    while readings[-1].stamp_s - readings[0].stamp_s < RestLimits().before_s:
        readings.append(good(robot))
    picture_s = CLOCK.monotonic()
    end_s = picture_s + 5.0
    while not is_covered(readings, picture_s) and CLOCK.monotonic() < end_s:
        readings.append(good(robot))
    mm, rad = rest_pose(readings, picture_s).distance(
        Pose.from_rotvec((0.1, 0.2, 0.3), (400.05, -120.05, 300.05))
    )
    assert mm < cell.mm
    assert rad < cell.rad


def test_time_stamps_advance_and_lie_in_the_recent_past(robot, stopwatch):
    stamps = [(good(robot), CLOCK.monotonic()) for _ in range(10)]
    assert np.all(np.diff([reading.stamp_s for reading, _ in stamps]) > 0)
    ages = [now - reading.stamp_s for reading, now in stamps]
    assert min(ages) >= 0
    stopwatch.judge("age of a reading", max(ages), 0.2)


def test_a_silent_controller_is_unavailable_in_time_at_once_and_at_open(cell, robot, stopwatch):
    cell.process.type("freeze on" if robot.__class__.__name__ == "UrRobot" else "silent on")
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable):
        [robot.read_flange(0.3) for _ in range(20)]
    stopwatch.judge("it is told", time.monotonic() - start, 0.8)
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable):
        cell.open(timeout_s=0.3)
    stopwatch.judge("it is told", time.monotonic() - start, 1.0)


def test_closing_twice_is_harmless_and_a_closed_robot_says_so(robot):
    robot.close()
    robot.close()
    with pytest.raises(DeviceUnavailable, match="closed"):
        robot.read_flange(0.1)


def test_a_controller_that_dies_is_unavailable_in_time(shared, stopwatch):
    """Last: it ends the process."""
    shared.process.type("reset")
    robot = shared.open()
    shared.process.kill()
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable):
        [robot.read_flange(0.3) for _ in range(20)]
    stopwatch.judge("it is told", time.monotonic() - start, 0.8)
    robot.close()
    with pytest.raises(DeviceUnavailable):
        shared.open(timeout_s=0.3)
