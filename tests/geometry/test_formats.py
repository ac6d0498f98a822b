import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry.rotation_formats import (
    RotationFormat,
    pose_from,
    rotation_from,
    rotation_to,
    value_count,
)

ROTVEC = (1.1, -2.2, 0.5)
FIXED_XYZ = (-175.587, -42.477, -128.586)
KUKA = (-128.586, -42.477, -175.587)
ZYZ = (-122.066, 137.338, -175.196)
CHECK = {
    "rotvec": ROTVEC,
    "rotvec-deg": tuple(np.degrees(ROTVEC)),
    "rpy-fixed-xyz": tuple(np.radians(FIXED_XYZ)),
    "rpy-fixed-xyz-deg": FIXED_XYZ,
    "fanuc-wpr-deg": FIXED_XYZ,
    "yaskawa-rxryrz-deg": FIXED_XYZ,
    "kuka-abc-deg": KUKA,
    "epson-uvw-deg": KUKA,
    "zyz-deg": ZYZ,
    "kawasaki-oat-deg": ZYZ,
}


@pytest.mark.parametrize(("name", "values"), CHECK.items())
def test_one_orientation_has_the_published_numbers_in_every_format(name, values):
    fmt = RotationFormat(name)
    np.testing.assert_allclose(
        rotation_from(values, fmt), Rotation.from_rotvec(ROTVEC).as_matrix(), atol=2e-5
    )
    tolerance = 2e-3 if name.endswith("deg") else 2e-5
    np.testing.assert_allclose(
        rotation_to(Rotation.from_rotvec(ROTVEC).as_matrix(), fmt), values, atol=tolerance
    )


def test_staubli_turns_about_the_axes_already_turned():
    a, b, c = np.radians((10.0, 20.0, 30.0))
    product = (
        Rotation.from_rotvec((a, 0, 0))
        * Rotation.from_rotvec((0, b, 0))
        * Rotation.from_rotvec((0, 0, c))
    )
    found = rotation_from((10, 20, 30), RotationFormat.STAUBLI_RXRYRZ_DEG)
    np.testing.assert_allclose(found, product.as_matrix(), atol=1e-12)


def test_quaternion_orders_differ_only_in_the_place_of_the_scalar():
    xyzw = Rotation.from_rotvec(ROTVEC).as_quat()
    wxyz = np.roll(xyzw, 1)
    for fmt, values in (
        (RotationFormat.QUATERNION_XYZW, xyzw),
        (RotationFormat.QUATERNION_WXYZ, wxyz),
        (RotationFormat.ABB_QUATERNION_WXYZ, wxyz),
    ):
        np.testing.assert_allclose(
            rotation_from(values, fmt), Rotation.from_rotvec(ROTVEC).as_matrix(), atol=1e-12
        )


@given(
    st.sampled_from(list(RotationFormat)),
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
)
def test_every_format_round_trips_any_orientation(fmt, rotvec):
    R = Rotation.from_rotvec(rotvec).as_matrix()
    values = rotation_to(R, fmt)
    assert values.shape == (value_count(fmt),)
    np.testing.assert_allclose(rotation_from(values, fmt), R, atol=1e-6)


@pytest.mark.parametrize("fmt", [f for f in RotationFormat if value_count(f) == 3])
def test_a_singular_orientation_gives_some_valid_angles_without_a_warning(fmt):
    for euler in ((0.3, np.pi / 2, 0.0), (0.3, 0.0, 0.0), (0.0, np.pi, 0.0)):
        R = Rotation.from_euler("xyz", euler).as_matrix()
        np.testing.assert_allclose(rotation_from(rotation_to(R, fmt), fmt), R, atol=1e-7)


def test_a_slightly_rounded_quaternion_still_gives_a_rotation():
    R = rotation_from((0.5004, 0.5, 0.5, 0.5), RotationFormat.QUATERNION_WXYZ)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("values", "fmt", "words"),
    [
        ((1, 2), "rotvec", "3 numbers"),
        ((1, 0, 0), "quaternion-wxyz", "4 numbers"),
        ((np.nan, 0, 0), "rotvec", "not finite"),
        ((np.inf, 0, 0), "zyz-deg", "not finite"),
        ((1, 0.1, 0, 0), "quaternion-xyzw", "length 1.005"),
        ((0, 0, 0, 0), "abb-quaternion-wxyz", "length 0"),
        (("a", 0, 0), "rotvec", "not a list of numbers"),
    ],
)
def test_bad_numbers_are_refused_by_naming_the_fault(values, fmt, words):
    with pytest.raises(InputError, match=words):
        rotation_from(values, RotationFormat(fmt))


def test_a_pose_in_metres_is_millimetres_inside():
    pose = pose_from((0.1, -0.2, 0.3, *ROTVEC), RotationFormat.ROTVEC, "m")
    np.testing.assert_allclose(pose.translation, (100, -200, 300))
    np.testing.assert_allclose(pose.rotvec(), ROTVEC)


@pytest.mark.parametrize(
    ("values", "unit", "words"),
    [
        ((0.1, 0.2, 0.3, 0, 0, 0), "inch", "unit 'inch'"),
        ((0.1, 0.2, 0.3, 0, 0), "m", "6 numbers"),
        ((np.nan, 0.2, 0.3, 0, 0, 0), "m", "finite"),
        ((None, {}, 0.3, 0, 0, 0), "m", "not a list of numbers"),
    ],
)
def test_a_bad_pose_is_refused_by_naming_the_fault(values, unit, words):
    with pytest.raises(InputError, match=words):
        pose_from(values, RotationFormat.ROTVEC, unit)
