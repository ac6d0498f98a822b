"""Stillness, the wire layouts, and what the device host refuses."""

import numpy as np
import pytest

from fakes.world.samples import Samples
from vgrd.devices import CameraImage, FlangeReading, wire
from vgrd.devices.checks import FrameCheck
from vgrd.devices.host import BadReadings, driver_module
from vgrd.devices.stillness import RestLimits, rest_pose
from vgrd.errors import BadReading, ConfigError, DeviceUnavailable, NotSteady, TooOld
from vgrd.geometry import Pose


def reading(stamp_s: float, x_mm: float = 0.0, turn_rad: float = 0.0) -> FlangeReading:
    return FlangeReading(
        Pose.from_rotvec((0, 0, turn_rad), (x_mm, 0, 0)), None, stamp_s, stamp_s + 100
    )


def test_a_flange_reading_survives_the_wire() -> None:
    for seed in range(20):
        sent = Samples(seed).flange(float(seed))
        got = wire.unpack_flange(wire.pack_flange(sent))
        assert np.array_equal(got.base_from_wrist.matrix(), sent.base_from_wrist.matrix())
        assert (got.wrist_from_tcp is None) == (sent.wrist_from_tcp is None)
        assert (got.stamp_s, got.controller_s) == (sent.stamp_s, sent.controller_s)
        assert (got.digital_inputs, got.running) == (sent.digital_inputs, sent.running)


def test_a_reading_that_is_no_rigid_motion_is_bad() -> None:
    payload = bytearray(wire.pack_flange(reading(1.0)))
    payload[16:24] = np.float64(2.0).tobytes()
    with pytest.raises(BadReading, match="flange reading"):
        wire.unpack_flange(bytes(payload))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_picture_survives_the_wire(dtype: type) -> None:
    pixels = np.random.default_rng(0).integers(0, 200, (5, 7)).astype(dtype)
    sent = CameraImage(pixels, 12.5, 3)
    got = wire.unpack_image(wire.pack_image_header(sent) + pixels.tobytes())
    assert np.array_equal(got.pixels, pixels)
    assert got.pixels.dtype == dtype
    assert (got.stamp_s, got.frame) == (12.5, 3)


def test_rest_is_the_mean_of_the_window() -> None:
    readings = [reading(0.008 * k, 0.01 * (k % 2)) for k in range(20)]
    assert rest_pose(readings, 0.1).translation[0] == pytest.approx(0.005, abs=0.002)


@pytest.mark.parametrize("motion", [(0.02, 0.0), (0.0, 1e-4)])
def test_a_moving_robot_is_not_steady(motion: tuple[float, float]) -> None:
    readings = [reading(0.008 * k, motion[0] * k, motion[1] * k) for k in range(20)]
    with pytest.raises(NotSteady, match="wait"):
        rest_pose(readings, 0.1)


def test_a_window_that_readings_do_not_cover_is_too_old() -> None:
    readings = [reading(0.008 * k) for k in range(10)]
    for stamp_s in (0.5, 0.07, 0.01):
        with pytest.raises(TooOld, match="cover"):
            rest_pose(readings, stamp_s)
    with pytest.raises(TooOld):
        rest_pose(readings[:1], 0.0, RestLimits())


def test_a_frozen_picture_is_refused() -> None:
    check = FrameCheck()
    pixels = np.zeros((2, 2), np.uint8)
    check.accept(CameraImage(pixels, 1.0, 1))
    with pytest.raises(BadReading, match="repeats"):
        check.accept(CameraImage(pixels, 2.0, 1))
    with pytest.raises(BadReading, match="repeats"):
        check.accept(CameraImage(pixels, 1.0, 2))
    check.accept(CameraImage(pixels, 2.0, 2))


def test_bad_readings_in_a_row_end_the_device_and_a_good_one_forgives() -> None:
    bad = BadReadings(limit=3)
    for _ in range(2):
        bad.bad(BadReading("NaN"))
    bad.good()
    for _ in range(2):
        bad.bad(BadReading("NaN"))
    with pytest.raises(DeviceUnavailable, match="3 bad readings"):
        bad.bad(BadReading("NaN"))


def test_an_unknown_driver_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'ur_rtde'"):
        driver_module("ur_rtdee")
