"""The pedal on a serial port: a press is told once, with its time; a lost port is told as one."""

import os

import pytest

from drivers import serial_pedal
from fakes.controllers.serial_line import SerialLine
from vgrd.clock import SystemClock
from vgrd.errors import ConfigError, DeviceUnavailable

CLOCK = SystemClock()
COMES_S, NOT_S = 20.0, 0.2


@pytest.fixture
def line():
    with SerialLine() as line:
        yield line


def press(line, told: bytes = b"1") -> None:
    foot = os.open(line.ends[0], os.O_WRONLY | os.O_NOCTTY)
    try:
        os.write(foot, told)
    finally:
        os.close(foot)


def test_a_press_is_told_once_with_its_time_however_many_bytes_it_sends(line):
    pedal = serial_pedal.open({"serial_port": line.ends[1], "quiet_s": 0.0}, CLOCK)
    assert pedal.wait_press(NOT_S) is None
    before_s = CLOCK.monotonic()
    press(line)
    stamp_s = pedal.wait_press(COMES_S)
    assert before_s <= stamp_s <= CLOCK.monotonic()
    pedal.close()
    with pytest.raises(DeviceUnavailable, match="lost"):
        pedal.wait_press(NOT_S)
    pedal.close()

    bouncing = serial_pedal.open({"serial_port": line.ends[1], "quiet_s": 60.0}, CLOCK)
    press(line, b"PRESSED\r\n")
    assert bouncing.wait_press(COMES_S) is not None
    assert bouncing.wait_press(NOT_S) is None
    bouncing.close()


def test_a_port_that_is_not_there_is_unavailable_and_bad_settings_are_told():
    with pytest.raises(DeviceUnavailable, match="/dev/no-such-port"):
        serial_pedal.open({"serial_port": "/dev/no-such-port"}, CLOCK)
    with pytest.raises(ConfigError, match="serial_port: is missing"):
        serial_pedal.open({}, CLOCK)
    with pytest.raises(ConfigError, match="baud: 1 bits per second: 50 or more"):
        serial_pedal.open({"serial_port": "/dev/ttyS0", "baud": 1}, CLOCK)
