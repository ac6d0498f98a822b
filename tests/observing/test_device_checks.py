"""Devices that lie: frozen, jumping, out of time, in the wrong unit."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.testing import ManualClock
from vgrd.devices import CameraImage, FlangeReading, wire
from vgrd.devices.checks import FlangeCheck, FrameCheck
from vgrd.devices.host import host_robot
from vgrd.errors import BadReading, DeviceRefused, DeviceUnavailable, InputError
from vgrd.geometry import Pose
from vgrd.ipc.health import HealthReporter
from vgrd.ipc.ring import RingReader

NOW_S = 1000.0
SIZE = (120, 160)


def picture(number, pixels):
    return CameraImage(pixels, float(number), number)


def scene(seed, dtype=np.uint8):
    """The same scene each time, with the noise of a sensor."""
    clean = np.linspace(0, 200, SIZE[0] * SIZE[1]).reshape(SIZE)
    noisy = clean + np.random.default_rng(seed).normal(0, 0.6, SIZE)
    return (np.clip(np.rint(noisy), 0, 255)).astype(dtype) * (257 if dtype is np.uint16 else 1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_frozen_picture_with_a_new_number_and_stamp_is_refused(dtype):
    check = FrameCheck()
    for number in range(1, 20):
        check.accept(picture(number, scene(number, dtype)))
    for number in (20, 21):
        with pytest.raises(BadReading, match="has the pixels of the one before; power it off"):
            check.accept(picture(number, scene(19, dtype).copy()))
    check.accept(picture(22, scene(22, dtype)))


@pytest.mark.parametrize("level", [0, 4, 15, 255])
def test_a_dark_hall_and_a_dazzled_camera_are_not_taken_for_a_frozen_one(level):
    """Where nothing but the black level or white is seen, two pictures may be the same; no tag is in them."""
    check = FrameCheck()
    for number in range(1, 5):
        check.accept(picture(number, np.full(SIZE, level, np.uint8)))


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((0, 1920), np.uint8),
        np.zeros((4, 5, 3), np.uint8),
        np.zeros(20, np.uint8),
        np.zeros((4, 5), np.float32),
    ],
)
def test_what_is_no_grey_picture_is_refused_and_the_next_one_is_taken(pixels):
    check = FrameCheck(SIZE[0] * SIZE[1])
    with pytest.raises(BadReading, match="not a grey picture"):
        check.accept(picture(1, pixels))
    check.accept(picture(1, scene(1)))


def test_a_picture_larger_than_the_cell_file_says_names_the_keys():
    check = FrameCheck(SIZE[0] * SIZE[1])
    with pytest.raises(BadReading, match=r"160 x 120 px, 16 bits.*size_px or bits"):
        check.accept(picture(1, scene(1, np.uint16)))


def read(stamp_s, x_mm=500.0, rotvec=(0.0, 0.0, 0.0)):
    return FlangeReading(Pose.from_rotvec(rotvec, (x_mm, 0, 300)), None, stamp_s, stamp_s)


def checked(*readings):
    check = FlangeCheck(ManualClock(NOW_S + 10))
    return [check.accept(reading) for reading in readings]


def test_time_that_stands_still_goes_back_or_lies_ahead_is_refused():
    for second_s in (NOW_S, NOW_S - 1.0, NOW_S + 10.2, math.nan, math.inf):
        with pytest.raises(BadReading, match=r"advance|ahead"):
            checked(read(NOW_S), read(second_s))


def test_a_jump_is_refused_also_when_it_stays_and_the_old_place_is_taken_again():
    check = FlangeCheck(ManualClock(NOW_S + 10))
    check.accept(read(NOW_S))
    for k in range(1, 60):
        with pytest.raises(BadReading, match=r"jumped by 500 mm, 0\.00 rad in 8 ms"):
            check.accept(read(NOW_S + 0.008 * k, 1000.0))
    check.accept(read(NOW_S + 0.008 * 60))
    with pytest.raises(BadReading, match="rad in"):
        check.accept(read(NOW_S + 0.008 * 61, rotvec=(0, 0, 2.5)))


def test_after_a_break_an_arm_may_stand_elsewhere():
    checked(read(NOW_S), read(NOW_S + 1.0, 1500.0, (0, 0, 3.0)))


@settings(deadline=None, derandomize=True)
@given(st.floats(0.0, 2 * math.pi), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.integers(0, 9))
def test_a_rotation_vector_that_wraps_at_pi_is_no_jump(about, rate_rad_s, tilt, start):
    axis = np.array([math.cos(about), math.sin(about), tilt])
    axis /= np.linalg.norm(axis)
    check = FlangeCheck(ManualClock(NOW_S + 10))
    for k in range(20):
        angle = math.pi + 0.002 * (start - 5) + rate_rad_s * 0.008 * (k - 10)
        if angle > math.pi:
            angle -= 2 * math.pi  # the same turn, from the other side
        check.accept(read(NOW_S + 0.008 * k, rotvec=tuple(angle * axis)))


@settings(deadline=None, derandomize=True)
@given(st.floats(2.0, 500.0), st.floats(0.0, 10_000.0), st.integers(0, 2**32 - 1))
def test_no_robot_is_too_fast(rate_hz, speed_mm_s, seed):
    rng = np.random.default_rng(seed)
    check = FlangeCheck(ManualClock(NOW_S + 100))
    for k in range(30):
        true_s = k / rate_hz
        stamp_s = NOW_S + true_s + rng.uniform(-1, 1) * min(0.2 / rate_hz, 0.01)
        check.accept(read(stamp_s, 100.0 + abs(speed_mm_s * true_s % 20_000.0 - 10_000.0)))


@pytest.mark.parametrize("place_mm", [(0.4, -0.1, 0.6), (400_000.0, 0.0, 300_000.0)])
def test_metres_taken_for_millimetres_and_the_reverse_are_refused_at_the_start(place_mm):
    reading = replace(read(NOW_S), base_from_wrist=Pose.from_rotvec((0, 0, 0), place_mm))
    with pytest.raises(DeviceRefused, match=r"are the units .* right \(mm_per_count\)"):
        checked(reading)


def test_a_gantry_at_home_and_an_arm_that_passes_the_origin_are_taken():
    home = replace(read(NOW_S), base_from_wrist=Pose.identity())
    near = replace(read(NOW_S + 0.1), base_from_wrist=Pose.from_rotvec((0, 0, 0), (1, 1, 1)))
    checked(home, near)


class Robot:
    """Gives what is in a list, then is gone."""

    def __init__(self, readings):
        self.readings = list(readings)

    def read_flange(self, timeout_s):
        if not self.readings:
            raise DeviceUnavailable("end")
        reading = self.readings.pop(0)
        if isinstance(reading, Exception):
            raise reading
        return reading

    def close(self):
        pass


def test_the_host_passes_on_good_readings_only(tmp_path: Path):
    clock = ManualClock(NOW_S + 10)
    readings = [
        read(NOW_S),
        InputError("a pose must be finite"),
        read(NOW_S + 0.008, 1000.0),
        read(NOW_S + 0.016, 501.0),
    ]
    with pytest.raises(DeviceUnavailable, match="end"):
        host_robot(Robot(readings), tmp_path, HealthReporter(tmp_path, "robot", clock), clock)
    ring = RingReader.open(tmp_path / wire.FLANGE_RING, wire.FLANGE_KIND)
    places = [
        wire.unpack_flange(message.payload).base_from_wrist.translation[0]
        for message in ring.since(0)
    ]
    assert places == [500.0, 501.0]


def test_a_robot_that_stays_where_it_jumped_to_is_given_up(tmp_path: Path):
    clock = ManualClock(NOW_S + 10)
    readings = [read(NOW_S)] + [read(NOW_S + 0.008 * k, 1000.0) for k in range(1, 60)]
    with pytest.raises(DeviceUnavailable, match="50 bad readings in a row, the last: the flange"):
        host_robot(Robot(readings), tmp_path, HealthReporter(tmp_path, "robot", clock), clock)
