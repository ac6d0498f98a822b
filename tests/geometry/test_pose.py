import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry import Pose, exp_rotation, hat, log_rotation, nearest_rotation

ROTATIONS = st.lists(st.floats(-1.75, 1.75), min_size=3, max_size=3)
LENGTHS = st.lists(st.floats(-500, 500), min_size=3, max_size=3)
SCALES = st.sampled_from((1.0, 1e-3, 1e-5, 1e-7, 1e-9, 0.0))


@st.composite
def tangents(draw):
    """Many turn next to nothing but move by up to half a metre: where Lie code breaks."""
    w = np.array(draw(ROTATIONS)) * draw(SCALES)
    return np.concatenate([draw(LENGTHS), w])


POSES = tangents().map(Pose.exp)


def close(a, b, atol=1e-8):
    np.testing.assert_allclose(a.matrix(), b.matrix(), atol=atol)


@given(POSES, POSES, POSES)
def test_poses_are_a_group(a, b, c):
    close((a @ b) @ c, a @ (b @ c))
    close(a @ Pose.identity(), a)
    close(a @ a.inverse(), Pose.identity())
    close((a @ b).inverse(), b.inverse() @ a.inverse())


@given(POSES, POSES, LENGTHS)
def test_composing_is_applying_one_after_the_other(a, b, point):
    p = np.array([point, point])
    np.testing.assert_allclose((a @ b) @ p, a @ (b @ p), atol=1e-8)


@given(tangents())
def test_log_is_the_inverse_of_exp(xi):
    np.testing.assert_allclose(Pose.exp(xi).log(), xi, atol=1e-8)


@given(POSES)
def test_exp_is_the_inverse_of_log(pose):
    close(Pose.exp(pose.log()), pose)


@given(POSES, tangents())
def test_the_adjoint_moves_a_tangent_through_a_pose(pose, xi):
    small = xi * 1e-2
    close(pose @ Pose.exp(small) @ pose.inverse(), Pose.exp(pose.adjoint() @ small), 1e-6)


@given(POSES, POSES)
def test_the_adjoint_is_a_homomorphism(a, b):
    np.testing.assert_allclose((a @ b).adjoint(), a.adjoint() @ b.adjoint(), atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-7, 1e-5, 1e-3, 0.0099, 0.0101, 0.099, 0.101, 2.9])
@pytest.mark.parametrize("length", [0.0, 1.0, 500.0])
def test_the_left_jacobian_agrees_with_finite_differences(angle, length):
    rng = np.random.default_rng(7)
    v, w = rng.normal(size=(2, 3))
    xi = np.concatenate([length * v / np.linalg.norm(v), angle * w / np.linalg.norm(w)])
    inverse = Pose.exp(xi).inverse()
    step = 1e-4
    numeric = np.column_stack(
        [
            ((Pose.exp(xi + step * d) @ inverse).log() - (Pose.exp(xi - step * d) @ inverse).log())
            / (2 * step)
            for d in np.eye(6)
        ]
    )
    np.testing.assert_allclose(Pose.left_jacobian(xi), numeric, atol=2e-5)


def test_the_left_jacobian_couples_translation_and_rotation_even_without_rotation():
    xi = np.array([500.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(Pose.left_jacobian(xi)[:3, 3:], 0.5 * hat(xi[:3]))


def test_arrays_of_a_pose_cannot_be_written_and_are_its_own():
    t = np.zeros(3)
    pose = Pose(np.eye(3), t)
    t[0] = 5
    assert pose.translation[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        pose.rotation[0, 0] = 2
    with pytest.raises(ValueError, match="read-only"):
        Pose.identity().translation[0] = 1


@given(ROTATIONS, LENGTHS)
def test_the_cross_product_matrix_is_the_cross_product(a, b):
    np.testing.assert_allclose(hat(np.array(a)) @ b, np.cross(a, b), atol=1e-9)


def test_a_half_turn_has_a_logarithm():
    for axis in np.eye(3):
        np.testing.assert_allclose(np.abs(log_rotation(exp_rotation(np.pi * axis))), np.pi * axis)


def test_distance_is_millimetres_and_radians():
    a = Pose.from_rotvec((0, 0, 0.3), (1, 2, 3))
    b = Pose.from_rotvec((0, 0, 0.1), (1, 2, 7))
    assert a.distance(b) == pytest.approx((4.0, 0.2))


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        (np.eye(3) * 1.01, np.zeros(3), "rotation matrix"),
        (np.diag([1.0, 1, -1]), np.zeros(3), "rotation matrix"),
        (np.full((3, 3), np.nan), np.zeros(3), "finite"),
        (np.eye(3), np.array([np.inf, 0, 0]), "finite"),
        (np.eye(4), np.zeros(3), "shapes"),
    ],
)
def test_what_is_not_a_rigid_motion_is_refused(rotation, translation, words):
    with pytest.raises(InputError, match=words):
        Pose(rotation, translation)


def test_a_matrix_is_projected_when_near_and_refused_when_far_from_a_rotation():
    M = np.eye(4)
    M[0, 0] = 1.0005
    assert Pose.from_matrix(M).rotation[0, 0] == pytest.approx(1)
    M[0, 0] = 1.01
    with pytest.raises(InputError, match="rotation"):
        Pose.from_matrix(M)
    with pytest.raises(InputError, match="last row"):
        Pose.from_matrix(np.ones((4, 4)))
    with pytest.raises(InputError, match="shape"):
        Pose.from_matrix(np.eye(3))


def test_a_mirrored_matrix_is_no_rotation():
    with pytest.raises(InputError, match="rotation"):
        nearest_rotation(np.diag([1.0, 1.0, -1.0]))


@given(ROTATIONS, st.sampled_from((1.0, 1e-4, 1e-9, 0.0)), st.sampled_from((0.0, np.pi)))
def test_the_logarithm_agrees_with_scipy_from_no_turn_to_half_a_turn(w, scale, more):
    w = np.array(w) * scale
    norm = np.linalg.norm(w)
    w = w + more * (w / norm if norm > 1e-6 else np.eye(3)[0])
    R = exp_rotation(w)
    expected = Rotation.from_matrix(R).as_rotvec()
    found = log_rotation(R)
    np.testing.assert_allclose(exp_rotation(found), R, atol=1e-12)
    assert np.linalg.norm(found) <= np.pi + 1e-12
    if np.linalg.norm(expected) < 3.1:
        np.testing.assert_allclose(found, expected, atol=1e-12)
