"""Profiles of robots' Modbus servers, and what the driver refuses."""

import socket
from dataclasses import MISSING, fields

import numpy as np
import pytest

from drivers import modbus_robot, robot_profile
from fakes.controllers.serial_line import SerialLine
from fakes.testing import FakeProcess, free_loopback
from vgrd.clock import SystemClock
from vgrd.errors import BadReading, ConfigError, DeviceRefused, DeviceUnavailable
from vgrd.geometry import Pose

CLOCK = SystemClock()
NAMES = sorted(path.stem for path in robot_profile.FOLDER.glob("*.toml"))


@pytest.mark.parametrize("name", NAMES)
def test_every_shipped_profile_loads_and_survives_a_round_trip(name):
    profile = robot_profile.load(name)
    wrist = Pose.from_rotvec((0.4, -2.0, 0.7), (412.3, -87.6, 301.2))
    tcp = Pose.from_rotvec((0.1, 0.0, -0.3), (10.0, 4.0, 120.0))
    pose, told = profile.decode(profile.encode(wrist, tcp))
    shown = wrist @ tcp if profile.frame == "tcp" else wrist
    mm, rad = pose.distance(shown)
    assert mm <= 4 * profile.position_sigma_mm + 1e-3
    assert rad <= 4 * profile.rotation_sigma_rad + 1e-5
    assert (told is None) == (name in ("jaka", "delta"))


def test_registers_hold_what_the_brands_document():
    wrist = Pose.from_rotvec((0.0, 0.0, np.radians(30)), (-123.4, 56.7, 1000.0))
    none = Pose.identity()
    ur = robot_profile.load("ur").encode(wrist, none)
    assert [ur[a] for a in range(400, 406)] == [65536 - 1234, 567, 10000, 0, 0, 524]
    delta = robot_profile.load("delta").encode(wrist, none)
    assert [delta[244], delta[245]] == [1_000_000 & 0xFFFF, 1_000_000 >> 16]
    assert [delta[250], delta[251]] == [30_000, 0]
    jaka = robot_profile.load("jaka").encode(wrist, none)
    assert [jaka[410], jaka[411]] == [0x447A, 0]  # 1000.0


def in_layout(folder, layout, **changed):
    """Profile of the UR with numbers in another layout."""
    lines = (robot_profile.FOLDER / "ur.toml").read_text().splitlines()
    new = {"layout": layout, "tcp_offset_address": 900, "pose_address": 100, **changed}
    kept = [line for line in lines if line.partition(" =")[0] not in new]
    written = [f"{k} = {v!r}".replace("'", '"') for k, v in new.items()]
    path = folder / "robot.toml"
    path.write_text("\n".join([*kept, *written]))
    return robot_profile.load(str(path))


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize(
    "layout", ["int16", "int32", "float32", "float64", "sign_magnitude16", "sign_magnitude32"]
)
def test_negative_numbers_survive_every_layout(tmp_path, layout, order):
    profile = in_layout(tmp_path, layout, word_order=order)
    wrist = Pose.from_rotvec((-0.4, -2.0, 0.7), (-412.3, 87.6, -301.2))
    pose, _ = profile.decode(profile.encode(wrist, Pose.identity()))
    mm, rad = pose.distance(wrist)
    assert mm <= 4 * profile.position_sigma_mm + 1e-3
    assert rad <= 4 * profile.rotation_sigma_rad + 1e-5


def test_sign_and_magnitude_have_the_sign_in_the_highest_bit(tmp_path):
    wrist = Pose.from_rotvec((0, 0, -0.5), (-123.4, 0.0, 56.7))
    short = in_layout(tmp_path, "sign_magnitude16").encode(wrist, Pose.identity())
    assert [short[a] for a in (100, 101, 102, 105)] == [0x8000 + 1234, 0, 567, 0x8000 + 500]
    long = in_layout(tmp_path, "sign_magnitude32").encode(wrist, Pose.identity())
    assert [long[100], long[101]] == [0x8000, 1234]
    unsigned = in_layout(tmp_path, "uint16").decode(
        {100: 40_000, 101: 0, 102: 1, 103: 0, 104: 0, 105: 0} | {900 + i: 0 for i in range(6)}
    )
    assert unsigned[0].translation.tolist() == pytest.approx([4000.0, 0.0, 0.1])


def test_an_angle_beyond_a_turn_is_a_wrong_layout(tmp_path):
    """Sign and magnitude read as two's complement: the position still looks right."""
    wrist = Pose.from_rotvec((0, 0, -0.5), (123.4, 20.0, 56.7))
    registers = in_layout(tmp_path, "sign_magnitude16").encode(wrist, Pose.identity())
    with pytest.raises(BadReading, match=r"beyond a turn; layout and rotation_per_count"):
        in_layout(tmp_path, "int16").decode(registers)


def test_every_key_and_layout_of_a_profile_is_documented():
    page = (robot_profile.FOLDER.parents[1] / "docs" / "robot-profiles.md").read_text()
    for field in fields(robot_profile.RobotProfile):
        assert f"| `{field.name}` | {'yes' if field.default is MISSING else 'no'} |" in page
    for layout in ("int16", "uint16", "int32", "float32", "float64", "sign_magnitude16"):
        assert f"| `{layout}` |" in page


def test_rounding_is_told_as_sigmas():
    ur = robot_profile.load("ur")
    assert ur.position_sigma_mm == pytest.approx(0.1 / 12**0.5)
    assert ur.rotation_sigma_rad == pytest.approx(0.001 / 12**0.5)
    assert robot_profile.load("techman").position_sigma_mm == 0.0


def test_the_steps_of_the_flange_are_those_of_the_registers_and_the_tool():
    tool = Pose.from_rotvec((0, 0, 0), (0.0, 90.0, 120.0))
    doosan = robot_profile.load("doosan").flange_steps(tool)
    assert doosan == pytest.approx((0.1 + 150.0 * np.radians(0.1), np.radians(0.1)))
    assert robot_profile.load("techman").flange_steps(tool) == (0.0, 0.0)


def test_a_profile_of_a_robot_too_slow_to_show_short_moves_is_refused(tmp_path):
    text = (robot_profile.FOLDER / "doosan.toml").read_text()
    path = tmp_path / "slow.toml"
    path.write_text(text.replace("update_period_s = 0.1", "update_period_s = 0.5"))
    with pytest.raises(ConfigError, match=r"update_period_s: 0 to 0\.2 s"):
        robot_profile.load(str(path))


def test_one_request_where_the_map_is_documented_without_a_gap_else_the_pose_is_read_twice():
    assert len(robot_profile.load("techman").blocks) == 1
    assert len(robot_profile.load("jaka").blocks) == 1
    assert len(robot_profile.load("ur").blocks) == 2


def test_a_wrong_word_order_is_a_bad_reading_not_a_pose():
    delta = robot_profile.load("delta")
    registers = delta.encode(Pose.from_rotvec((0, 0, 0.5), (400, 300, 200)), Pose.identity())
    swapped = {a: registers[a ^ 1] for a in registers}
    with pytest.raises(BadReading, match="word order"):
        delta.decode(swapped)


def test_a_tcp_pose_without_an_offset_is_refused():
    with pytest.raises(ConfigError, match="give tcp_offset"):
        modbus_robot.open({"host": "127.0.0.4", "profile": "jaka"}, CLOCK)


def test_all_faults_of_a_profile_are_told_at_once(tmp_path):
    text = (robot_profile.FOLDER / "ur.toml").read_text()
    bad = text.replace('"int16"', '"int17"').replace('"rotvec"', '"euler"').replace('"tcp"', '"?"')
    path = tmp_path / "mine.toml"
    path.write_text(bad)
    with pytest.raises(ConfigError) as caught:
        robot_profile.load(str(path))
    assert len(caught.value.faults) == 3
    path.write_text(text + "pose_adress = 3\n")
    with pytest.raises(ConfigError, match=r"mine\.toml.*\npose_adress: unknown key"):
        robot_profile.load(str(path))
    with pytest.raises(ConfigError, match="techman"):
        robot_profile.load("kuka")


def test_another_profile_than_the_robots_is_refused_at_open_and_busy_is_one_bad_reading():
    host = free_loopback(30004)
    with socket.socket() as probe:
        probe.bind((host, 0))
        port = probe.getsockname()[1]
    with FakeProcess("modbus-robot", "--host", host, "--port", str(port)) as process:
        settings = {"host": host, "port": port, "unit": 255}
        with pytest.raises(DeviceRefused, match="right profile"):
            modbus_robot.open(settings | {"profile": "techman"}, CLOCK)
        robot = modbus_robot.open(settings | {"profile": "ur"}, CLOCK)
        process.type("refuse on")
        with pytest.raises(BadReading, match="refuses"):
            robot.read_flange(0.5)
        process.type("refuse off")
        assert robot.read_flange(0.5).running
        robot.close()


def test_a_robot_on_a_serial_port_is_read_by_rtu_and_its_silence_is_a_lost_link():
    wrist = Pose.from_rotvec((0.3, -1.1, 0.6), (412.3, -87.6, 301.2))
    with SerialLine() as line:
        robot_end, our_end = line.ends
        with FakeProcess("modbus-robot", "--profile", "ur", "--serial-port", robot_end) as process:
            process.type("tcp 0 0 100 0 0 0")
            process.type("pose 412.3 -87.6 301.2 0.3 -1.1 0.6")
            settings = {"serial_port": our_end, "baud": 115200, "profile": "ur"}
            robot = modbus_robot.open(settings, CLOCK)
            reading = [robot.read_flange(2.0) for _ in range(20)][-1]
            mm, rad = reading.base_from_wrist.distance(wrist)
            assert rad < 0.002
            assert mm < 0.1 + 100 * rad
            process.type("silent on")
            with pytest.raises(DeviceUnavailable, match=r"Universal Robots.* at /dev/pts.*answer"):
                robot.read_flange(0.3)
            robot.close()


def test_a_serial_port_that_is_not_there_is_unavailable_with_its_name():
    with pytest.raises(DeviceUnavailable, match="/dev/no-such-port"):
        modbus_robot.open({"serial_port": "/dev/no-such-port", "profile": "ur"}, CLOCK)


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({}, "give host .* or serial_port"),
        ({"host": "127.0.0.4", "serial_port": "/dev/ttyS0"}, "one of them"),
        ({"serial_port": "/dev/ttyS0", "port": 502}, "named by serial_port"),
        ({"serial_port": "/dev/ttyS0", "parity": "X"}, "none of N, E, O"),
        ({"serial_port": "/dev/ttyS0", "baud": 0}, "bits per second"),
    ],
)
def test_network_and_serial_port_are_not_mixed_up(settings, fault):
    with pytest.raises(ConfigError, match=fault):
        modbus_robot.open({"profile": "ur", **settings}, CLOCK)
