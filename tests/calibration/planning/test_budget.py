from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import Simulation
from vgrd.calibration.joint.camera_corrections import PriorSigmas
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.planning.budget import Source, Systematic, error_budget
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import ArmModel, Policy

FIELD_ARM = ArmErrors(sigma_mm=0.04, field_mm=0.12)
SYSTEMATIC = Systematic(PriorSigmas(0.05, 0.05, 3.0, 2.0), 0.1)


def model(arm, **quanta):
    return ArmModel(arm.sigma_mm, arm.field_mm, arm.length_mm, arm.rad_per_mm, **quanta)


@cache
def taught(seed=1, arm=None, **options):
    sim = Simulation(seed, **options)
    wrists = [sim.wrist()] * 4 + [sim.wrist(0.4) for _ in range(4)]
    recording = sim.record(looks=4, spins=4, wrists=wrists)
    return (
        sim,
        recording,
        calibrate_joint(recording, arm=arm or ArmModel(), robust=False, find_noise=False),
    )


def share(budget, link):
    return budget.shares[:, budget.links.index(link)]


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("arm", [ArmModel(), ArmModel(0.05), ArmModel(0.03, 0.15)])
def test_shares_sum_to_one_and_the_radius_is_that_of_the_answer(arm, policy):
    sim, _, result = taught(arm=arm)
    seen = sim.request().seen.tag_b
    budget = error_budget(result, seen, policy)
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1)
    assert (budget.shares >= -1e-9).all()
    radii = [expected_by_joint(result, name, seen, policy).u95_mm for name in budget.targets]
    np.testing.assert_allclose(budget.u95_mm, radii, rtol=1e-3)


def test_the_worst_link_has_the_largest_share():
    sim, _, result = taught(vision=FINE)
    assert (share(error_budget(result, sim.request().seen.tag_b), Source.TOUCHES) > 0.9).all()
    sim, _, result = taught(touch_sigma_mm=0.001)
    by_tags = error_budget(result, sim.request().seen.tag_b)
    assert (share(by_tags, Source.TOUCHES) < 0.05).all()
    sim, _, result = taught(touch_sigma_mm=0.01, vision=FINE, arm=ArmModel(0.2))
    budget = error_budget(result, sim.request().seen.tag_b)
    assert (share(budget, Source.REPEATABILITY) > 0.9).all()
    sim, _, result = taught(touch_sigma_mm=0.01, vision=FINE, arm=ArmModel(quantum_mm=0.5))
    budget = error_budget(result, sim.request().seen.tag_b)
    assert (share(budget, Source.QUANTISATION) > 0.8).all()


def test_links_that_are_not_there_have_no_row_and_nothing_is_left_over():
    sim, _, result = taught()
    budget = error_budget(result, sim.request().seen.tag_b)
    links = set(budget.links)
    assert not links & {Source.REPEATABILITY, Source.FIELD, Source.QUANTISATION, Source.TCP}
    assert not links & {Source.PRINT, Source.INTRINSICS, Source.TIME, Source.HOLES}
    np.testing.assert_array_equal(share(budget, Source.EXCESS), 0)
    np.testing.assert_array_equal(share(budget, Source.UNDETERMINED), 0)


def test_time_and_systematic_errors_count_once_they_are_given():
    sim, _, result = taught()
    seen = sim.request().seen.tag_b
    without = error_budget(result, seen)
    budget = error_budget(result, seen, systematic=SYSTEMATIC)
    for link in (Source.INTRINSICS, Source.PRINT, Source.TIME):
        assert (share(budget, link) > 0).all()
    assert (budget.u95_mm > without.u95_mm).all()
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1)
    assert (
        Source.INTRINSICS
        in error_budget(result, seen, systematic=Systematic.of(result.recording.facts)).links
    )


def test_what_was_refined_counts_as_refined():
    sim, recording, _ = taught()
    refinement = PriorSigmas(tag_a_mm=0.05, tag_b_mm=0.05, focal_px=3.0)
    result = calibrate_joint(recording, arm=ArmModel(), refine=refinement, find_noise=False)
    budget = error_budget(result, sim.request().seen.tag_b, systematic=SYSTEMATIC)
    for link in (Source.INTRINSICS, Source.PRINT):
        assert (share(budget, link) > 0).all()
    np.testing.assert_allclose(budget.shares.sum(axis=1), 1)


def shifted(recording, of_a, of_b):
    """The recording with every tag seen where a function of its pose puts it."""

    def seen(observation):
        tags = {
            name: replace(tag, camera_from_tag=of(tag.camera_from_tag))
            for name, tag, of in (
                ("tag_a", observation.tag_a, of_a),
                ("tag_b", observation.tag_b, of_b),
            )
        }
        return replace(observation, **tags)

    return replace(
        recording,
        looks=tuple(map(seen, recording.looks)),
        spins=tuple(map(seen, recording.spins)),
        touches=tuple(replace(t, observation=seen(t.observation)) for t in recording.touches),
    )


def test_a_larger_print_moves_the_answer_as_the_budget_says():
    sim, recording, result = taught(touch_sigma_mm=0.02)
    seen, factor = sim.request().seen, 1.0001
    other = shifted(recording, lambda A: Pose(A.rotation, A.translation / factor), lambda B: B)
    moved = answer(calibrate_joint(other, arm=ArmModel(), robust=False, find_noise=False), seen)
    moved = moved - answer(result, seen)
    other = shifted(recording, lambda A: A, lambda B: Pose(B.rotation, B.translation / factor))
    tag = seen.tag_b
    nearer = Pose(tag.camera_from_tag.rotation, tag.camera_from_tag.translation / factor)
    again = calibrate_joint(other, arm=ArmModel(), robust=False, find_noise=False)
    by_b = answer(again, replace(seen, tag_b=replace(tag, camera_from_tag=nearer)))
    by_b = by_b - answer(result, seen)
    sigma = 0.0001 * recording.facts.tag_a.size_mm
    print_only = Systematic(PriorSigmas(sigma, sigma))
    assert variance(result, tag, Source.PRINT, print_only) == pytest.approx(
        moved @ moved + by_b @ by_b, rel=0.1
    )


def answer(result, seen, target="P3"):
    return expected_by_joint(result, target, seen).base_from_wrist.translation


def variance(result, tag, link, systematic=None, target="P3"):
    """Trace, mm^2, of one link's covariance."""
    plain = np.trace(expected_by_joint(result, target, tag).position_covariance)
    budget = error_budget(result, tag, systematic=systematic, targets=[target])
    given = sum(
        share(budget, one)[0] for one in budget.links if one in (Source.PRINT, Source.INTRINSICS)
    )
    return share(budget, link)[0] * plain / (1 - given)


class Noisy:
    """A perfect session whose stated noise is real for one link only, drawn again and again."""

    def __init__(self, arm=None, **quanta):
        self.arm = model(arm, **quanta) if arm else ArmModel(**quanta)
        quiet = Simulation(3, touch_sigma_mm=0.0)
        quiet.vision = quiet.vision.finer(1e6)
        wrists = [quiet.wrist()] * 3 + [quiet.wrist(0.4) for _ in range(3)]
        noisy = Simulation(3)
        true = quiet.record(looks=3, spins=3, wrists=wrists)
        stated = noisy.record(looks=3, spins=3, wrists=wrists)
        self.covariances = {
            "tag_a": stated.looks[0].tag_a.covariance,
            "tag_b": stated.spins[0].tag_b.covariance,
        }
        touches = tuple(
            replace(
                t, lateral_sigma_mm=0.2, axial_sigma_mm=0.2, observation=self.stated(t.observation)
            )
            for t in true.touches
        )
        self.true = replace(
            true,
            looks=tuple(map(self.stated, true.looks)),
            spins=tuple(map(self.stated, true.spins)),
            touches=touches,
        )
        self.now = self.stated(quiet.observe(quiet.standing, 1.3))
        self.rng = np.random.default_rng(9)

    def stated(self, observation):
        return replace(
            observation,
            **{
                name: replace(getattr(observation, name), covariance=covariance)
                for name, covariance in self.covariances.items()
            },
        )

    def seen(self, observation, name):
        tag = getattr(observation, name)
        off = np.linalg.cholesky(tag.covariance) @ self.rng.normal(size=6)
        seen = replace(tag, camera_from_tag=Pose.exp(off) @ tag.camera_from_tag)
        return replace(observation, **{name: seen})

    def touched(self):
        touches = []
        for t in self.true.touches:
            pose = t.base_from_wrist
            off = Pose(pose.rotation, pose.translation + 0.2 * self.rng.normal(size=3))
            touches.append(replace(t, base_from_wrist=off))
        return replace(self.true, touches=tuple(touches)), self.now, np.zeros(6)

    def tags(self, name):
        def seen(observation):
            return self.seen(observation, name)

        recording = replace(
            self.true,
            looks=tuple(map(seen, self.true.looks)),
            spins=tuple(map(seen, self.true.spins)),
            touches=tuple(replace(t, observation=seen(t.observation)) for t in self.true.touches),
        )
        return recording, seen(self.now), np.zeros(6)

    def moved(self, deviations):
        """The arm reports poses from which it is off by deviations (s, 6), touches first."""
        samples = [*self.true.touches, *self.true.looks, *self.true.spins]
        off = []
        for sample, d in zip(samples, deviations, strict=True):
            pose = sample.base_from_wrist
            reported = Pose(exp_rotation(-d[3:]) @ pose.rotation, pose.translation - d[:3])
            pressed = {"base_from_wrist": reported}
            if hasattr(sample, "observation"):
                seen = replace(sample.observation, base_from_wrist=reported)
                pressed["observation"] = seen
            off.append(replace(sample, **pressed))
        m, k = len(self.true.touches), len(self.true.looks)
        return replace(
            self.true,
            touches=tuple(off[:m]),
            looks=tuple(off[m : m + k]),
            spins=tuple(off[m + k :]),
        )

    def places(self, target):
        samples = [*self.true.touches, *self.true.looks, *self.true.spins]
        places = [sample.base_from_wrist.translation for sample in samples]
        return np.array([*places, self.solved(self.true, self.now, target)])

    def drawn(self, correlation):
        """Deviations with a correlation between stands, the last one at the answer."""
        L = np.linalg.cholesky(correlation + 1e-12 * np.eye(len(correlation)))
        d = (L @ self.rng.normal(size=(len(L), 6))) * self.arm.scales()
        return self.moved(d[:-1]), self.now, d[-1]

    def solved(self, recording, now, target="P3"):
        result = calibrate_joint(recording, arm=self.arm, robust=False, find_noise=False)
        return answer(result, now, target)

    def misses(self, draw, count, target="P3"):
        """What the tip misses by, (count, 3), as its wrist is not turned by the arm's small errors."""
        nominal = calibrate_joint(self.true, arm=self.arm, robust=False, find_noise=False)
        expected = expected_by_joint(nominal, target, self.now)
        at, tip = expected.base_from_wrist.translation, expected.base_from_wrist.rotation
        tip = tip @ nominal.state.tcp_in_wrist
        out = []
        for _ in range(count):
            recording, now, d = draw()
            out.append(self.solved(recording, now, target) - at + d[:3] + np.cross(d[3:], tip))
        return np.array(out)

    def check(self, link, draw, count=24):
        nominal = calibrate_joint(self.true, arm=self.arm, robust=False, find_noise=False)
        predicted = variance(nominal, self.now.tag_b, link)
        found = np.mean(np.sum(self.misses(draw, count) ** 2, axis=1))
        assert found == pytest.approx(predicted, rel=0.45)


@pytest.mark.parametrize(
    ("link", "draw", "arm"),
    [
        (Source.TOUCHES, lambda cell: cell.touched(), None),
        (Source.TOUCHES, lambda cell: cell.touched(), FIELD_ARM),
        (Source.HAND_EYE, lambda cell: cell.tags("tag_a"), None),
        (Source.TAG_B, lambda cell: cell.tags("tag_b"), None),
    ],
)
def test_a_share_is_what_the_noise_of_its_link_alone_does(link, draw, arm):
    cell = Noisy(arm)
    cell.check(link, lambda: draw(cell))


def test_repeatability_and_the_field_do_what_their_shares_say():
    cell = Noisy(FIELD_ARM)
    at = cell.places("P3")
    own = cell.arm.sigma_mm**2 * np.eye(len(at))
    cell.check(Source.REPEATABILITY, lambda: cell.drawn(own))
    cell.check(Source.FIELD, lambda: cell.drawn(cell.arm.field(at, at)))


def test_rounding_does_what_its_share_says():
    cell = Noisy(quantum_mm=0.2)

    def rounded():
        d = np.zeros((len(cell.places("P3")) - 1, 6))
        d[:, :3] = cell.rng.uniform(-0.1, 0.1, (len(d), 3))
        return cell.moved(d), cell.now, np.zeros(6)

    cell.check(Source.QUANTISATION, rounded)


def test_the_tcp_along_the_axis_of_four_axes_is_irrelevant_and_costs_nothing():
    sim = Simulation(4, one_axis=True)
    recording = sim.record(looks=4, spins=4, wrists=[sim.wrist(1.5) for _ in range(6)])
    result = calibrate_joint(recording, arm=ArmModel(), robust=False, find_noise=False)
    budget = error_budget(result, sim.request().seen.tag_b, Policy.FOLLOW)
    assert "the TCP along (0.00, 0.00, 1.00) of the flange" in budget.irrelevant
    assert (share(budget, Source.UNDETERMINED) < 0.01).all()
    assert (budget.u95_mm < 0.6).all()
    six_axes = taught()[2]
    assert error_budget(six_axes, sim.request().seen.tag_b).irrelevant == ()


def test_the_table_names_every_target_and_link():
    sim, _, result = taught()
    rows = error_budget(result, sim.request().seen.tag_b).rows()
    assert [row["target"] for row in rows] == [f"P{k}" for k in range(1, 7)]
    links = [value for key, value in rows[0].items() if key not in ("target", "u95_mm")]
    assert sum(links) == pytest.approx(1)
