import numpy as np
import pytest

from vgrd.errors import InputError, NotObservable
from vgrd.geometry import Pose
from vgrd.geometry.covariance import (
    covariance_from,
    mean_pose,
    observability,
    radius95,
    sqrt_information,
    wide_directions,
)


@pytest.mark.parametrize("sigmas", [(1, 1, 1), (1, 1, 0), (1, 0, 0), (1, 0.5, 0.2), (3, 0.3, 0.1)])
def test_the_radius_holds_ninety_five_percent(sigmas):
    rng = np.random.default_rng(0)
    x = np.linalg.norm(rng.normal(size=(400_000, 3)) * sigmas, axis=1)
    assert radius95(np.diag(np.square(sigmas))) == pytest.approx(np.quantile(x, 0.95), rel=0.03)


def test_no_uncertainty_has_no_radius():
    assert radius95(np.zeros((3, 3))) == 0


def test_the_covariance_of_a_linear_estimate_is_the_inverse_of_its_information():
    J = np.random.default_rng(1).normal(size=(30, 4)) * [1e-3, 1, 10, 1e4]
    np.testing.assert_allclose(covariance_from(J) @ J.T @ J, np.eye(4), atol=1e-6)


def test_the_wide_axes_of_a_covariance_come_as_long_as_their_sigma():
    axis = np.array([2.0, -1.0, 2.0]) / 3
    covariance = 0.1 * np.eye(3) + 400.0 * np.outer(axis, axis)
    wide = wide_directions(covariance, 10.0)
    np.testing.assert_allclose(wide @ wide.T, 400.1 * np.outer(axis, axis), rtol=1e-9)
    assert wide_directions(covariance, 21.0).shape == (3, 0)


def test_dependent_columns_are_refused_with_their_rank():
    J = np.random.default_rng(1).normal(size=(30, 4))
    J[:, 3] = J[:, 0] + J[:, 1]
    with pytest.raises(NotObservable, match="3 of 4") as caught:
        covariance_from(J)
    assert (caught.value.rank, caught.value.unknowns) == (3, 4)


def test_the_undetermined_direction_is_told():
    J = np.random.default_rng(1).normal(size=(30, 3))
    J[:, 2] = J[:, 1]
    found = observability(J, np.ones(3), 1e-6)
    assert found.rank == 2
    np.testing.assert_allclose(np.abs(found.undetermined[0]), [0, 0.5**0.5, 0.5**0.5], atol=1e-12)


def test_a_whitener_makes_the_covariance_one():
    A = np.random.default_rng(2).normal(size=(6, 6))
    C = A @ A.T + np.eye(6)
    W = sqrt_information(C)
    np.testing.assert_allclose(W @ C @ W.T, np.eye(6), atol=1e-9)


@pytest.mark.parametrize("bad", [np.zeros((6, 6)), -np.eye(6), np.full((6, 6), np.nan)])
def test_what_is_no_covariance_is_refused(bad):
    with pytest.raises(InputError, match="positive definite"):
        sqrt_information(bad)
    with pytest.raises(InputError, match="positive definite"):
        mean_pose([Pose.identity()], [bad])


def test_a_mean_of_poses_lies_where_the_certain_ones_are():
    rng = np.random.default_rng(3)
    truth = Pose.from_rotvec((0.3, -2.0, 0.4), (100, -50, 600))
    loose, tight = np.diag([1.0] * 3 + [1e-4] * 3), np.diag([1e-4] * 3 + [1e-8] * 3)
    covariances = [loose, loose, tight, tight]
    poses = [Pose.exp(rng.multivariate_normal(np.zeros(6), c)) @ truth for c in covariances]
    mean, covariance = mean_pose(poses, covariances)
    xi = (mean @ truth.inverse()).log()
    assert xi @ np.linalg.solve(covariance, xi) < 20
    assert mean.distance(truth)[0] < 0.5
    np.testing.assert_allclose(covariance, tight / 2, rtol=1e-3, atol=1e-12)
