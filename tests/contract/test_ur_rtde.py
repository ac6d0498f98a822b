"""The driver with the real ur-rtde against the fake controller in a process of its own."""

import math
import time

import numpy as np
import pytest
import rtde_receive

from drivers import ur_rtde
from fakes.testing import FakeProcess, free_loopback
from vgrd.clock import SystemClock
from vgrd.errors import BadReading, ConfigError, DeviceRefused, DeviceUnavailable
from vgrd.geometry import Pose

CLOCK = SystemClock()
WRIST = Pose.from_rotvec((0.0, math.pi, 0.0), (400.0, -100.0, 350.0))


def opened(host, **settings):
    return ur_rtde.open({"host": host, "timeout_s": 1.0} | settings, CLOCK)


@pytest.fixture(scope="module")
def shared():
    with FakeProcess("rtde", "--host", free_loopback(30004)) as process:
        yield process


@pytest.fixture
def controller(shared):
    shared.type("reset")
    return shared


@pytest.fixture
def host(controller):
    return controller.option("--host")


@pytest.fixture
def robot(host):
    robot = opened(host)
    yield robot
    robot.close()


def settled(robot):
    """Read until the stream is good again, at most a second."""
    end = time.monotonic() + 1.0
    while True:
        try:
            return robot.read_flange(1.0)
        except BadReading:
            assert time.monotonic() < end


def read_many(robot, count):
    return [robot.read_flange(0.3) for _ in range(count)]


def test_the_offset_of_the_pendant_does_not_move_the_flange_and_its_change_is_never_mixed(
    controller, robot
):
    assert robot.read_flange(1.0).wrist_from_tcp.translation == pytest.approx((12, -3, 152))
    controller.type("tcp 0 40 90 0.3 0 1.2")
    dropped = 0
    for _ in range(20):
        try:
            reading = robot.read_flange(1.0)
        except BadReading:
            dropped += 1
            continue
        mm, rad = reading.base_from_wrist.distance(WRIST)
        assert mm < 1e-6
        assert rad < 1e-7
    assert dropped <= 3
    assert reading.wrist_from_tcp.translation == pytest.approx((0, 40, 90))


def test_stamps_follow_the_motion_to_a_millisecond(controller, robot):
    """The fake circles in ten seconds of the machine's clock: the pose tells its own time."""
    controller.type("circle 20")
    settled(robot)
    readings = read_many(robot, 40)
    error_s = []
    for reading in readings:
        x, y, _ = reading.base_from_wrist.translation - WRIST.translation
        phase = math.atan2(y, x) - 2 * math.pi / 10.0 * reading.stamp_s
        error_s.append(math.remainder(phase, 2 * math.pi) * 10.0 / (2 * math.pi))
    assert np.median(np.abs(error_s)) < 2e-3
    assert np.all(np.diff([reading.controller_s for reading in readings]) > 0)


def test_a_late_stream_keeps_the_time_at_which_its_poses_were_true(controller, robot):
    for _ in range(10):
        robot.read_flange(1.0)
    controller.type("late 0.1")
    robot.read_flange(1.0)
    reading = robot.read_flange(1.0)
    assert CLOCK.monotonic() - reading.stamp_s > 0.095


def test_repeated_samples_are_one_sample(controller, robot):
    controller.type("repeat on")
    stamps = [reading.controller_s for reading in read_many(robot, 20)]
    assert np.all(np.diff(stamps) > 0)


@pytest.mark.parametrize("jump_s", [-3.0, 3.0])
def test_a_jump_of_the_controllers_clock_costs_at_most_a_few_samples(
    controller, robot, jump_s, stopwatch
):
    before = robot.read_flange(1.0)
    controller.type(f"clock {jump_s}")
    bad = 0
    for _ in range(30):
        try:
            reading = robot.read_flange(1.0)
        except BadReading:
            bad += 1
            continue
        age_s = CLOCK.monotonic() - reading.stamp_s
        assert age_s >= 0.0
        stopwatch.judge("age of a reading", age_s, 0.2)
    assert bad <= 6
    assert bad > 0 or jump_s > 0
    assert abs(reading.controller_s - before.controller_s - jump_s) < 2.0


def test_not_a_number_is_a_bad_reading_and_the_next_pose_is_good(controller, robot):
    controller.type("nan on")
    with pytest.raises(BadReading, match="finite"):
        read_many(robot, 5)
    controller.type("nan off")
    assert settled(robot).base_from_wrist.distance(WRIST)[0] < 1e-6


def test_protective_stop_clears_running(controller, robot):
    assert robot.read_flange(1.0).running
    controller.type("protective-stop on")
    assert not read_many(robot, 5)[-1].running


def test_inputs_arrive_as_bits_and_text_messages_are_harmless(controller, robot):
    controller.type("text hello there")
    controller.type("inputs 65541")
    assert read_many(robot, 5)[-1].digital_inputs == 65541


@pytest.mark.parametrize("fault", ["freeze on", "drop fin", "drop rst"])
def test_a_lost_stream_is_unavailable_in_time_and_closes_cleanly(
    controller, robot, fault, stopwatch
):
    robot.read_flange(1.0)
    controller.type(fault)
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable):
        read_many(robot, 100)
    stopwatch.judge("it is told", time.monotonic() - start, 1.0)
    robot.close()
    with pytest.raises(DeviceUnavailable, match="closed"):
        robot.read_flange(0.3)


def test_a_controller_that_is_killed_does_not_take_the_process_with_it():
    host = free_loopback(30004)
    with FakeProcess("rtde", "--host", host) as process:
        robot = opened(host)
        process.kill()
        robot.close()
    with pytest.raises(DeviceUnavailable, match=host):
        opened(host)


def test_a_silent_controller_is_unavailable_within_the_time_limit(controller, host, stopwatch):
    controller.type("silent on")
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable, match="does not answer"):
        opened(host, timeout_s=0.3)
    stopwatch.judge("it is told", time.monotonic() - start, 0.6)


def test_a_controller_without_data_is_never_handed_to_ur_rtde(controller, host, stopwatch):
    controller.type("freeze on")
    start = time.monotonic()
    with pytest.raises(DeviceUnavailable, match="sends no data"):
        opened(host, timeout_s=0.3)
    stopwatch.judge("it is told", time.monotonic() - start, 1.0)


def test_an_old_controller_is_refused_by_name_of_what_it_lacks(controller, host):
    controller.type("missing tcp_offset")
    with pytest.raises(DeviceRefused, match="has no tcp_offset"):
        opened(host)


def test_wrong_settings_are_told_all_at_once():
    with pytest.raises(ConfigError) as caught:
        ur_rtde.open({"hots": "127.0.0.2", "frequency_hz": "fast"}, CLOCK)
    text = str(caught.value)
    assert all(
        part in text for part in ("hots: unknown", "host: is missing", "frequency_hz", "timeout_s")
    )
    with pytest.raises(ConfigError, match=r"frequency_hz: must be in 5 \.\. 500"):
        ur_rtde.open({"host": "127.0.0.2", "frequency_hz": 2.0}, CLOCK)


def test_the_default_recipe_of_ur_rtde_connects_as_well(host):
    receiver = rtde_receive.RTDEReceiveInterface(host)
    assert receiver.getActualTCPPose()[2] == pytest.approx(0.198)
