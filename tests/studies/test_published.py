"""The paper's equations as printed: right where nothing is lost, wrong by what is lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.studies.conducting import conduct
from fakes.studies.paper.published.equations import equation_16, equation_19, equation_25
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Pose

SEEDS = st.integers(0, 10_000)


def pose(rng, spread=300.0):
    return Pose.from_rotvec(rng.uniform(-1.5, 1.5, 3), rng.uniform(-spread, spread, 3))


def value(outcome, name):
    (figure,) = [f for f in outcome.figures if f.name == name]
    return figure.value


class Moved:
    """A target and a pivot of the object, before (ref) and after (now) flange and object moved."""

    def __init__(self, seed, flange_mm):
        rng = np.random.default_rng(seed)
        wrist_from_tag_a, base_from_camera = pose(rng, 50), pose(rng)
        self.tcp = rng.uniform(-100, 100, 3)
        point, self.pivot = rng.uniform(-80, 80, (2, 3))
        ref = pose(rng)
        self.shift = flange_mm * np.array([0.6, 0.0, 0.8])
        now = Pose(ref.rotation, ref.translation + self.shift)
        B0, B1 = pose(rng), pose(rng)
        A0, A1 = (base_from_camera.inverse() @ wrist @ wrist_from_tag_a for wrist in (ref, now))
        self.ref, self.now = A0.inverse() @ B0, A1.inverse() @ B1
        self.base_from_tag_a = now @ wrist_from_tag_a
        self.tcp_in_base = ref.rotation @ self.tcp
        self.point_in_tag_a = self.ref @ point
        self.flange, self.pivot_flange = (
            (base_from_camera @ B0) @ p - self.tcp_in_base for p in (point, self.pivot)
        )
        self.truth = (base_from_camera @ B1) @ point - self.tcp_in_base

    def equation_16(self, tcp_in_base):
        return equation_16(
            self.base_from_tag_a, self.now, self.ref, self.point_in_tag_a, tcp_in_base
        )

    def equation_19(self):
        R = self.base_from_tag_a.rotation
        return equation_19(R, self.now, self.ref, self.pivot, self.flange, self.pivot_flange)


@settings(max_examples=40)
@given(SEEDS, st.floats(0, 200))
def test_equation_16_is_off_by_twice_the_tcp_and_right_with_its_sign_mended(seed, flange_mm):
    cell = Moved(seed, flange_mm)
    off = cell.equation_16(cell.tcp_in_base) - cell.truth
    np.testing.assert_allclose(off, 2 * cell.tcp_in_base, atol=1e-9)
    np.testing.assert_allclose(cell.equation_16(-cell.tcp_in_base), cell.truth, atol=1e-9)


@settings(max_examples=40)
@given(SEEDS, st.floats(0, 200))
def test_equation_19_lacks_exactly_the_way_of_the_flange(seed, flange_mm):
    cell = Moved(seed, flange_mm)
    np.testing.assert_allclose(cell.equation_19() + cell.shift, cell.truth, atol=1e-9)


def test_equation_25_finds_the_point_about_which_a_ball_joint_turns():
    rng = np.random.default_rng(2)
    center, place = np.array([30.0, -40.0, 5.0]), np.array([10.0, 20.0, 600.0])
    turns = [pose(rng).rotation for _ in range(6)]
    found = equation_25([Pose(R, place - R @ center) for R in turns])
    np.testing.assert_allclose(found.center_in_tag, center, atol=1e-9)
    assert found.condition < 100


def test_equation_25_has_no_inverse_where_all_turns_share_an_axis():
    turns = [Pose.from_rotvec((0, 0, angle), (0, 0, 600)) for angle in (0.0, 1.0, 2.0)]
    with pytest.raises(NotObservable, match="no inverse"):
        equation_25(turns)
    with pytest.raises(TooFewObservations, match="at least 2 pictures"):
        equation_25(turns[:1])


def test_the_better_the_camera_the_worse_the_matrix_of_equation_25(tmp_path):
    outcome = conduct("eq25", runs=15, folder=tmp_path, plot=False)
    conditions = [
        value(outcome, f"{noise}: condition of the matrix of Eq. 25")
        for noise in ("coarse", "quarter", "fine", "exact")
    ]
    assert conditions == sorted(conditions)
    assert conditions[-1] > 1e14
    assert value(outcome, "exact: Eq. 25, answer") > 1
    assert value(outcome, "exact: ours, answer") < 1e-9
    assert value(outcome, "coarse: Eq. 25, along the axis, 95 % below") > 5


def test_gauss_newton_goes_wrong_with_few_touches_and_the_certified_answer_does_not(tmp_path):
    outcome = conduct("eq9", runs=40, folder=tmp_path, plot=False)
    assert value(outcome, "4 touches within 180 degrees: Gauss-Newton wrong") > 2
    assert value(outcome, "12 touches within 180 degrees: Gauss-Newton wrong") == 0
    assert value(outcome, "answers without a certificate") == 0
    assert value(outcome, "4 touches within 180 degrees: 95 % of errors below, certified") < 3


def test_the_flange_that_moved_is_the_error_of_equation_19(tmp_path):
    outcome = conduct("eq19", runs=10, folder=tmp_path, plot=False)
    assert outcome.ok
    assert value(outcome, "moved by 10 mm: Eq. 19") == pytest.approx(10, abs=0.7)
    assert value(outcome, "moved by 100 mm: Eq. 19 with the displacement") < 0.8
    assert value(outcome, "moved by 100 mm: Eq. 16, sign mended") < 1.0
