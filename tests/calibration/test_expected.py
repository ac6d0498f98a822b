import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vgrd.calibration.stepwise.equations import (
    flange_for,
    motion_about,
    moved_flange,
    point_in_base_live,
    special_expected,
)
from vgrd.errors import InputError
from vgrd.geometry import Pose


def pose(rng, spread=300.0):
    return Pose.from_rotvec(rng.uniform(-1.5, 1.5, 3), rng.uniform(-spread, spread, 3))


class Cell:
    """One cell before (ref) and after (now) the object and the flange moved."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.base_from_camera = pose(rng)
        self.wrist_from_tag_a = pose(rng, 50)
        self.tcp = rng.uniform(-100, 100, 3)
        self.point, self.pivot = rng.uniform(-80, 80, (2, 3))
        self.wrist_ref = pose(rng)
        self.wrist_now = Pose(self.wrist_ref.rotation, rng.uniform(-300, 300, 3))
        self.tag_b_ref, self.tag_b_now = pose(rng), pose(rng)

    def tag_a(self, wrist):
        return self.base_from_camera.inverse() @ wrist @ self.wrist_from_tag_a

    def equation_6(self, wrist, tag_b, point):
        in_base = point_in_base_live(wrist, self.wrist_from_tag_a, self.tag_a(wrist), tag_b, point)
        return flange_for(in_base, self.wrist_ref.rotation, self.tcp)

    def equation_19(self, wrist_now):
        return special_expected(
            base_from_wrist_ref=self.wrist_ref,
            base_from_wrist_now=wrist_now,
            tag_a_from_tag_b_ref=self.tag_a(self.wrist_ref).inverse() @ self.tag_b_ref,
            tag_a_from_tag_b_now=self.tag_a(wrist_now).inverse() @ self.tag_b_now,
            R_wrist_from_tag_a=self.wrist_from_tag_a.rotation,
            pivot_in_tag_b=self.pivot,
            flange_ref=self.equation_6(self.wrist_ref, self.tag_b_ref, self.point),
            pivot_flange_ref=self.equation_6(self.wrist_ref, self.tag_b_ref, self.pivot),
        )


SEEDS = st.integers(0, 10_000)


@settings(max_examples=60)
@given(SEEDS)
def test_equation_19_equals_equation_6_also_when_the_flange_moved_between_the_pictures(seed):
    cell = Cell(seed)
    for wrist in (cell.wrist_ref, cell.wrist_now):
        np.testing.assert_allclose(
            cell.equation_19(wrist),
            cell.equation_6(wrist, cell.tag_b_now, cell.point),
            atol=1e-8,
        )


@settings(max_examples=60)
@given(SEEDS)
def test_the_fixed_camera_and_the_live_tag_give_one_point(seed):
    cell = Cell(seed)
    live = point_in_base_live(
        cell.wrist_now,
        cell.wrist_from_tag_a,
        cell.tag_a(cell.wrist_now),
        cell.tag_b_now,
        cell.point,
    )
    fixed = (cell.base_from_camera @ cell.tag_b_now) @ cell.point
    np.testing.assert_allclose(live, fixed, atol=1e-8)


@settings(max_examples=60)
@given(SEEDS)
def test_equation_19_for_a_camera_that_stands_still_needs_no_tag_a(seed):
    cell = Cell(seed)
    Q = motion_about(cell.tag_b_now, cell.tag_b_ref, cell.pivot)
    np.testing.assert_allclose(
        moved_flange(
            cell.base_from_camera.rotation,
            Q,
            cell.equation_6(cell.wrist_ref, cell.tag_b_ref, cell.point),
            cell.equation_6(cell.wrist_ref, cell.tag_b_ref, cell.pivot),
        ),
        cell.equation_6(cell.wrist_ref, cell.tag_b_now, cell.point),
        atol=1e-8,
    )


@settings(max_examples=60)
@given(SEEDS)
def test_the_motion_about_a_point_moves_every_point_as_the_plain_motion_does(seed):
    """The appendix, Eq. 28-30."""
    cell = Cell(seed)
    motion = cell.tag_b_now @ cell.tag_b_ref.inverse()
    Q = motion_about(cell.tag_b_now, cell.tag_b_ref, cell.pivot)
    p_1, p = cell.tag_b_ref @ cell.pivot, cell.point
    np.testing.assert_allclose(motion @ p, Q @ (p - p_1) + p_1, atol=1e-9)
    R, t = motion.rotation, motion.translation
    np.testing.assert_allclose(Q.translation, R @ p_1 + t - p_1, atol=1e-9)


@settings(max_examples=60)
@given(SEEDS)
def test_the_appendix_leaves_one_motion_only_and_it_is_the_one_that_serves(seed):
    """Eq. 28 for arbitrary p, solved for X by least squares: Eq. 29 and 30."""
    cell = Cell(seed)
    H = cell.tag_b_now @ cell.tag_b_ref.inverse()
    p_1 = cell.tag_b_ref @ cell.pivot
    p = np.random.default_rng(seed).uniform(-300, 300, (12, 3))
    moved = np.array([H @ one for one in p])
    rows = np.column_stack([p - p_1, np.ones(12)])
    X, _, rank, _ = np.linalg.lstsq(rows, moved - p_1, rcond=None)
    assert rank == 4
    R_X, t_X = X[:3].T, X[3]
    np.testing.assert_allclose(R_X, H.rotation, atol=1e-9)
    np.testing.assert_allclose(t_X, H.rotation @ p_1 + H.translation - p_1, atol=1e-6)
    Q = motion_about(cell.tag_b_now, cell.tag_b_ref, cell.pivot)
    np.testing.assert_allclose(Q.rotation, R_X, atol=1e-9)
    np.testing.assert_allclose(Q.translation, t_X, atol=1e-6)


def test_a_wrist_turned_between_the_pictures_is_refused():
    cell = Cell(1)
    turned = cell.wrist_now @ Pose.from_rotvec((0, 0, np.radians(0.1)))
    with pytest.raises(InputError, match=r"turned by 0\.100 degrees"):
        cell.equation_19(turned)
