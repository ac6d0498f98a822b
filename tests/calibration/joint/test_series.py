"""Pictures in their order: a small slip shows in their sum, an error that stays does not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.joint import calibrate_joint, solution_of
from vgrd.calibration.joint.sequence.belief import Belief, Unexplained
from vgrd.cell.serving.camera_memory import CameraMemory
from vgrd.geometry import Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.model import ArmKnowledge, ArmModel, CameraPlace, FlangeTag, Instant, Link, frozen_array

ARM = ArmErrors(sigma_mm=0.03, field_mm=0.15)
FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
ANYWHERE = frozen_array([np.inf] * 6, 6)
SIGMAS = 4.0  # of a slip in one picture: four of five pictures do not tell it
PERIOD_S = 0.5
STABILITY_MM = 0.5  # of FIXED


@cache
def taught(seed):
    sim = Simulation(seed, vision=FINE, arm=ARM, center_sigma_mm=0.02)
    tilted = [sim.wrist(np.radians(25)) for _ in range(4)]
    recording = sim.record(wrists=[sim.wrist()] * 6 + tilted)
    arm = ArmModel(ARM.sigma_mm, ARM.field_mm, ARM.length_mm, ARM.rad_per_mm)
    return sim, solution_of(calibrate_joint(recording, arm=arm)), recording.facts


def lifted(mm):
    return Pose.from_rotvec((0, 0, 0), (0, 0, mm))


def slipped(tag, slip):
    return replace(tag, camera_from_tag=tag.camera_from_tag @ slip)


def biased(tag, sigmas):
    way = np.linalg.cholesky(tag.covariance) @ sigmas
    return replace(tag, camera_from_tag=Pose.exp(way) @ tag.camera_from_tag)


class Cell:
    """A cell that takes pictures at 2 Hz, and what its series says of them."""

    def __init__(self, seed, stability=FIXED, poses=3):
        self.sim, self.solution, self.facts = taught(seed)
        self.series = self.solution.series(self.facts, stability)
        self.stability, self.memory = stability, CameraMemory(stability)
        rng = self.rng = np.random.default_rng(seed)
        self.stands = [
            Pose(WORK_ROTATION, self.sim.standing.translation + rng.uniform(-80, 80, 3))
            for _ in range(poses)
        ]
        self.now_s = 0.0
        self.slip, self.bias = Pose.identity(), None

    def small_slip(self):
        """Of tag B, off its plane, as large as one picture is expected to misfit by SIGMAS; and its mm."""
        seen, probe_mm = self.sim.observe(self.stands[0], 0.4), 0.05
        place = CameraPlace(self.stability, FlangeTag(seen.tag_a, self.stands[0]))
        misfits = [
            self.solution.examine(self.facts, slipped(seen.tag_b, lifted(z)), place).misfit
            for z in (-probe_mm, 0, probe_mm)
        ]
        size_mm = SIGMAS / np.sqrt(np.diff(misfits, 2)[0] / 2) * probe_mm
        return lifted(size_mm), size_mm

    def rest(self, pictures=6, **how):
        """Go somewhere, turn the table, take pictures; their reports."""
        stand = self.stands[self.rng.integers(len(self.stands))]
        self.there = stand, self.sim._draw(), self.now_s, self.rng.uniform(-np.pi, np.pi)
        return self.stay(pictures, **how)

    def stay(self, pictures, *, tag_a=True, creep=None):
        """Take pictures; their reports."""
        is_seen = tag_a
        stand, draw, since_s, angle = self.there
        reports = []
        for _ in range(pictures):
            self.now_s += PERIOD_S
            seen = self.sim.observe(stand, angle, draw)
            if creep is not None:
                self.slip = self.slip @ creep
            tag_a, tag_b = seen.tag_a, slipped(seen.tag_b, self.slip)
            if self.bias is not None:
                tag_a, tag_b = (
                    biased(tag, sigmas)
                    for tag, sigmas in zip((tag_a, tag_b), self.bias, strict=True)
                )
            sight = SimpleNamespace(
                tag_a=tag_a if is_seen else None, base_from_wrist=stand, stamp_s=self.now_s
            )
            self.memory.see(sight)
            place = self.memory.place(sight)
            reports.append(self.series.see(tag_b, place, Instant(self.now_s, since_s, is_seen)))
        return reports

    def rests(self, count, **how):
        return [report for _ in range(count) for report in self.rest(**how)]


def first_refused(reports):
    return next((i for i, report in enumerate(reports) if not report.fits), None)


@pytest.mark.parametrize("stability", [FIXED, ANYWHERE], ids=["fixed", "movable"])
def test_a_slip_that_no_picture_tells_shows_in_their_sum_and_is_named(stability):
    for seed in range(4):
        cell = Cell(seed, stability)
        assert first_refused(cell.rests(12)) is None
        cell.slip, size_mm = cell.small_slip()
        reports = cell.rests(10)
        assert first_refused(reports) is not None
        last = reports[-1]
        assert last.lasting
        assert Link.TAG_B in last.suspects
        assert last.slips[Link.TAG_B][0] == pytest.approx(size_mm, rel=0.5)


def test_an_error_that_was_there_from_the_first_picture_is_taken_for_one_of_the_calibration():
    cell = Cell(5)
    cell.slip = lifted(0.3 * cell.small_slip()[1])
    assert first_refused(cell.rests(30)) is None


def test_twelve_poses_of_a_good_cell_do_not_alarm():
    for seed in (6, 7):
        assert first_refused(Cell(seed, poses=12).rests(60)) is None


def test_a_slip_lasts_until_pictures_show_that_it_is_gone():
    cell = Cell(8)
    cell.rests(12)
    slip = cell.slip = cell.small_slip()[0]
    assert any(cell.rest()[-1].lasting for _ in range(20))
    assert "confirm in a moment" in cell.series.resume()
    cell.rests(8)
    assert "tag B sits elsewhere" in cell.series.resume()
    cell.slip = Pose.identity()
    reports = cell.rests(40)
    assert all(report.lasting for report in reports)  # nobody has said that it is gone
    assert cell.series.resume() == ""
    assert first_refused(cell.rests(10)) is None
    cell.slip = slip  # what was learned before the first slip still counts
    assert first_refused(cell.rests(20)) is not None


def test_a_creep_is_not_learned_for_good():
    cell = Cell(9)
    cell.rests(12)
    step = lifted(0.001)  # 2 um a second
    assert first_refused(cell.rests(150, creep=step)) is not None


def test_a_slip_is_found_although_the_arm_never_moves():
    cell = Cell(10, poses=1)
    assert first_refused(cell.rest(pictures=40)) is None
    cell.slip = cell.small_slip()[0]
    assert first_refused(cell.stay(40)) is not None


def test_a_picture_that_contradicts_alone_is_not_learned():
    cell = Cell(11)
    cell.rests(6)
    mean = cell.series._belief.mean[:20].copy()
    cell.slip = lifted(5.0)
    assert not cell.rest(pictures=1)[0].fits
    cell.slip = Pose.identity()
    np.testing.assert_array_equal(cell.series._belief.mean[:20], mean)
    assert first_refused(cell.rests(5)) is None


def test_a_slip_shows_while_tag_a_is_hidden_and_a_camera_that_walks_does_not():
    cell = Cell(12)
    cell.rests(6)
    assert first_refused(cell.rests(20, tag_a=False)) is None
    cell.slip = lifted(STABILITY_MM)
    reports = cell.rests(4, tag_a=False)  # in time its camera may have walked as far
    assert first_refused(reports) == 0
    assert Link.TAG_B in reports[0].suspects


def test_a_cell_that_never_shows_tag_a_is_judged_too():
    for seed in (13, 14):
        cell = Cell(seed)
        assert first_refused(cell.rests(30, tag_a=False)) is None
        cell.slip = lifted(STABILITY_MM)
        assert first_refused(cell.rests(4, tag_a=False)) is not None


def test_a_knock_is_named_while_tag_a_is_hidden_and_followed_once_it_is_seen():
    cell = Cell(15)
    cell.rests(6)
    knock = Pose.from_rotvec((0, 0.01, 0), (0, 0, 3.0))
    home, cell.sim.base_from_camera = cell.sim.base_from_camera, cell.sim.base_from_camera @ knock
    try:
        reports = cell.rest(tag_a=False)
        assert first_refused(reports) == 0
        assert Link.CAMERA in reports[0].suspects
        assert first_refused(cell.rests(8)) is None
        assert first_refused(cell.rests(4, tag_a=False)) is None
    finally:
        cell.sim.base_from_camera = home


def test_what_pictures_of_a_table_that_stands_share_does_not_alarm():
    for seed in range(30, 36):
        cell = Cell(seed, poses=6)
        angle = 0.4
        bias = [0.7 * cell.sim.rng.normal(size=6), 0.7 * cell.sim.rng.normal(size=6)]
        cell.bias = bias  # of each tag, in sigmas of a picture: print, lens and light
        reports = []
        for _ in range(50):
            cell.rest(pictures=0)
            cell.there = (*cell.there[:3], angle)
            reports += cell.stay(2)
        assert first_refused(reports) is None


def test_a_slip_that_changed_is_told_by_its_newest_pictures():
    cell = Cell(17)
    cell.rests(12)
    size_mm = cell.small_slip()[1]
    cell.slip = lifted(size_mm)
    assert any(cell.rest()[-1].lasting for _ in range(20))
    cell.rests(8)
    cell.slip = lifted(-size_mm)
    cell.rests(24)
    slip = cell.series.slip(Link.TAG_B)
    error = slip.tangent[2] + size_mm
    assert abs(error) < 3 * np.sqrt(slip.covariance[2, 2])
    assert abs(error) < 0.5 * size_mm


def test_sums_of_a_good_cell_are_no_larger_than_chance():
    squares = []
    for seed in range(3):
        cell = Cell(20 + seed)
        for _ in range(40):
            cell.rest()
            for of_link in cell.series._sums[0].sums:
                told, _ = of_link.told()
                squares.append((float(told @ told), len(told)))
    share = np.mean([square > chi2_quantile(0.99, freedom) for square, freedom in squares])
    assert share < 0.02


def test_what_is_learned_is_the_posterior_of_all_pictures_together():
    """The filter against one least-squares problem with all rows, which knows nothing of filters."""
    rng = np.random.default_rng(3)
    n, flanges = 4, [np.array([0.0, 0, 0]), np.array([150.0, 40, 0])]
    model = ArmModel(0.03, 0.15, 200.0, 1e-3)
    none = ArmKnowledge(model, np.zeros((0, 3)), np.zeros(0), np.zeros((0, n)), np.zeros((0, 0)))
    prior = np.diag(rng.uniform(0.5, 2.0, n))
    belief = Belief(prior, none, np.zeros(6))
    order = [0, 0, 1, 0]
    J, J_scene = rng.normal(size=(4, 5, n + 6)), rng.normal(size=(4, 5, 12))
    J[:, :, n:] *= 10
    values = rng.normal(size=(4, 5))
    for t, where in enumerate(order):
        if t in (0, 2, 3):
            belief.begin_rest()
            belief.begin_scene()
        picture = Unexplained(values[t], J[t], J_scene[t], np.zeros((5, 6)), {}, flanges[where])
        belief.learn(belief.compare(picture))

    scales = model.scales() ** 2
    field = np.kron(model.field(np.array(flanges), np.array(flanges)), np.diag(scales))
    total = np.zeros((n + 12 + 18 + 36,) * 2)  # unknowns, field of two poses, three rests, scenes
    total[:n, :n], total[n : n + 12, n : n + 12] = prior, field
    for k in range(3):
        rest = slice(n + 12 + 6 * k, n + 18 + 6 * k)
        total[rest, rest] = np.diag(0.03**2 * scales)
    total[n + 30 :, n + 30 :] = np.eye(36)
    H = np.zeros((20, len(total)))
    for t, (where, rest) in enumerate(zip(order, (0, 0, 1, 2), strict=True)):
        rows = slice(5 * t, 5 * t + 5)
        H[rows, :n] = J[t, :, :n]
        H[rows, n + 6 * where : n + 6 * where + 6] = J[t, :, n:]
        H[rows, n + 12 + 6 * rest : n + 18 + 6 * rest] = J[t, :, n:]
        H[rows, n + 30 + 12 * rest : n + 42 + 12 * rest] = J_scene[t]
    gain = total @ H.T @ np.linalg.inv(H @ total @ H.T + np.eye(20))
    np.testing.assert_allclose(belief.mean[:n], -(gain @ values.ravel())[:n], atol=1e-6)
    posterior = (total - gain @ H @ total)[:n, :n]
    np.testing.assert_allclose(belief.covariance[:n, :n], posterior, atol=1e-6)
