"""A camera that moved while it was taught is followed where tag A was seen."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.studies.sessions import known_arm
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.marginal import solution_of
from vgrd.calibration.joint.problem import HolePixel
from vgrd.calibration.joint.rows import arm_jacobian, linearize
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import layout_of
from vgrd.calibration.stepwise.equations import (
    flange_for,
    point_in_base_live,
    special_expected,
)
from vgrd.errors import TagNotSeen
from vgrd.geometry import Pose
from vgrd.model import (
    ArmModel,
    CameraPlace,
    FlangeTag,
    Motion,
    Policy,
    Stability,
    TagObservation,
    frozen_copy,
)

TILT = np.radians(25)
ARM = ArmErrors(sigma_mm=0.03, field_mm=0.15)
ANYWHERE = frozen_copy(np.full(6, np.inf))
EXACT = ArmModel()


class Moving(Simulation):
    """A camera that stands elsewhere in every picture, by `moved_mm` and as many mrad."""

    moved_mm = 0.0
    stability = Stability.MOVABLE
    motion = Motion.TURNTABLE

    def observe(self, *arguments, **options):
        if self.moved_mm:
            self.base_from_camera = Simulation.base_from_camera @ displacement(
                self.rng, self.moved_mm
            )
        return super().observe(*arguments, **options)

    def facts(self):
        facts = super().facts()
        spec = replace(facts.object, motion=self.motion)
        return replace(facts, object=spec, camera_stability=self.stability)


class Exact(Moving):
    """Without any noise, though its covariances are stated."""

    def _see(self, spec, truth):
        seen = super()._see(spec, truth)
        return TagObservation(spec, truth, seen.covariance, seen.corners_px, 0.0)


def displacement(rng, moved_mm):
    shift, turn = rng.normal(size=(2, 3))
    shift, turn = shift / np.linalg.norm(shift), turn / np.linalg.norm(turn)
    return Pose.exp(moved_mm * np.concatenate([shift, 1e-3 * turn]))


def mixed(sim, fixed=6, tilted=4):
    return [sim.wrist()] * fixed + [sim.wrist(TILT) for _ in range(tilted)]


def cell(kind, seed, moved_mm, motion=Motion.TURNTABLE, **options):
    sim = kind(seed, **options)
    sim.moved_mm, sim.motion = moved_mm, motion
    return sim


def answer(sim, solution, facts, request):
    """What is served in a picture, the camera anywhere."""
    seen = request.seen
    place = CameraPlace(ANYWHERE, FlangeTag(seen.tag_a, seen.base_from_wrist))
    target = facts.object.targets[request.target]
    return solution.expected_for(facts, target, seen.tag_b, Policy.FIXED, WORK_ROTATION, place)


@pytest.mark.parametrize("motion", list(Motion))
@pytest.mark.parametrize("moved_mm", [0.0, 1.0, 300.0])
def test_exact_pictures_give_exact_values_wherever_the_camera_stood_in_each(moved_mm, motion):
    sim = cell(Exact, 1, moved_mm, motion, touch_sigma_mm=0.0)
    recording = sim.record(wrists=mixed(sim))
    standing = sim.base_from_camera
    fit = calibrate_joint(recording, arm=EXACT)
    state = fit.state
    for name in ("wrist_from_tag_a", "object_from_tag_b"):
        mm, rad = getattr(state, name).distance(getattr(sim, name))
        assert mm < 1e-9, name
        assert rad < 1e-12, name
    np.testing.assert_allclose(state.tcp_in_wrist, sim.tcp_in_wrist, atol=1e-9)
    assert fit.cost < 1e-9
    assert not [sample.name for sample in fit.samples if not sample.used]
    mm, rad = state.base_from_camera.distance(standing)
    assert mm < 1e-9
    assert rad < 1e-12


def states_near(fit, rng, size=1e-2):
    step = rng.normal(size=fit.layout.size) * np.where(fit.layout.is_length(), size, 1e-3 * size)
    return fit.state.retract(step, fit.layout)


def test_derivatives_are_those_of_the_residuals():
    sim = cell(Moving, 3, 5.0, vision=FINE)
    recording = sim.record(wrists=mixed(sim, 4, 3), looks=2, spins=4)
    holes = [
        HolePixel("P2", np.array([1900.0, 1500]), 0.1, touch=0),
        HolePixel("P3", np.array([2100.0, 1600]), 0.1, spin=2),
        HolePixel("P4", np.array([2100.0, 1600]), 0.1),
    ]
    data = gather(recording, holes, EXACT)
    layout = layout_of(data)
    fit = calibrate_joint(recording, arm=EXACT, robust=False)
    state = states_near(fit, np.random.default_rng(0))
    J = linearize(state, data, layout)[1]
    for column, h in enumerate(np.where(layout.is_length(), 1e-5, 1e-8)):
        step = np.zeros(layout.size)
        step[column] = h
        more, less = (
            linearize(state.retract(sign * step, layout), data, layout)[0] for sign in (1, -1)
        )
        slope = (more - less) / (2 * h)
        np.testing.assert_allclose(
            J[:, column], slope, atol=2e-5 * max(np.abs(J[:, column]).max(), 1), err_msg=column
        )


def test_the_derivative_by_the_arm_is_that_of_the_flange_pose():
    sim = cell(Moving, 4, 20.0, vision=FINE)
    recording = sim.record(wrists=mixed(sim, 3, 2), looks=2, spins=3)
    data = gather(recording, arm=EXACT)
    fit = calibrate_joint(recording, arm=EXACT, robust=False)
    G = arm_jacobian(fit.state, data).reshape(data.arm_rows, -1, 6)
    for k, look in enumerate(data.looks.poses()):
        rows = slice(6 * k, 6 * k + 6)
        for axis, h in enumerate([1e-5] * 3 + [1e-8] * 3):
            tangent = np.zeros(6)
            tangent[axis] = h
            at = look.translation
            there = Pose(np.eye(3), at) @ Pose.exp(tangent) @ Pose(np.eye(3), -at) @ look
            R, t = data.looks.rotations.copy(), data.looks.translations.copy()
            R[k], t[k] = there.rotation, there.translation
            moved = replace(data, looks=replace(data.looks, rotations=R, translations=t))
            r, _ = linearize(fit.state, moved, fit.layout)
            slope = (r[rows] - linearize(fit.state, data, fit.layout)[0][rows]) / h
            column = G[rows, data.looks.stations[k], axis]
            np.testing.assert_allclose(slope, column, atol=1e-3 * np.abs(G[rows]).max())


def test_a_camera_that_stands_still_is_estimated_as_before_to_the_last_bit():
    recording = Simulation(5).record()
    data = gather(recording)
    assert data.places.displaced == 0
    assert layout_of(data).places == 0
    assert guess(data).taught_from_camera == ()


def test_the_order_of_the_samples_is_that_of_their_stamps():
    sim = cell(Moving, 6, 5.0, arm=ARM)
    recording = sim.record(wrists=mixed(sim), spins=6, looks=4)
    shuffled = replace(
        recording,
        looks=recording.looks[::-1],
        spins=tuple(np.random.default_rng(1).permutation(np.array(recording.spins, dtype=object))),
        touches=recording.touches[3:] + recording.touches[:3],
    )
    a, b = (calibrate_joint(one, arm=known_arm(ARM)) for one in (recording, shuffled))
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert a.state.base_from_camera.distance(b.state.base_from_camera) == (0.0, 0.0)


def test_a_picture_that_shows_one_tag_tells_nothing_where_the_camera_may_stand_anywhere():
    sim = cell(Moving, 7, 5.0, vision=FINE)
    recording = sim.record(wrists=mixed(sim))
    unseen = tuple(replace(spin, tag_a=None) for spin in recording.spins[:3])
    with_them = replace(recording, spins=(*unseen, *recording.spins[3:]))
    without = replace(recording, looks=(), spins=recording.spins[3:])
    solutions = [
        solution_of(calibrate_joint(one, arm=EXACT, robust=False)) for one in (with_them, without)
    ]
    sigmas = [np.sqrt(np.diag(solution.covariance)) for solution in solutions]
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=1e-4)
    assert [solution.undetermined.shape[1] for solution in solutions] == [0, 0]


def test_a_camera_that_tag_a_never_told_of_has_no_place():
    sim = cell(Moving, 8, 5.0)
    recording = sim.record(wrists=mixed(sim))
    request = sim.request()
    solution = solution_of(calibrate_joint(recording))
    target = recording.facts.object.targets[request.target]
    with pytest.raises(TagNotSeen, match="bring tag A into view"):
        solution.expected_for(
            recording.facts,
            target,
            request.seen.tag_b,
            Policy.FIXED,
            WORK_ROTATION,
            CameraPlace(ANYWHERE),
        )


def test_what_is_stated_holds_wherever_the_camera_stood():
    squares = {"tcp": [], "tag a": [], "answer": []}
    for seed in range(60):
        sim = cell(Moving, seed, 300.0, vision=FINE, arm=ARM, center_sigma_mm=0.02)
        recording = sim.record(wrists=mixed(sim))
        fit = calibrate_joint(recording, arm=known_arm(ARM))
        request = sim.request()
        expected = answer(sim, solution_of(fit), recording.facts, request)
        miss = sim.miss(request, expected.base_from_wrist)
        for name, error, covariance in (
            (
                "tcp",
                fit.state.tcp_in_wrist - sim.tcp_in_wrist,
                fit.covariance[fit.layout.TCP, fit.layout.TCP],
            ),
            (
                "tag a",
                (sim.wrist_from_tag_a @ fit.state.wrist_from_tag_a.inverse()).log(),
                fit.covariance[fit.layout.TAG_A, fit.layout.TAG_A],
            ),
            ("answer", miss, expected.position_covariance),
        ):
            squares[name].append(error @ np.linalg.solve(covariance, error) / len(error))
    for name, values in squares.items():
        assert np.mean(values) == pytest.approx(1, abs=0.25), name


@pytest.mark.parametrize("moved_mm", [1.0, 300.0])
def test_equation_19_and_equation_6_give_the_answer_of_a_session_whose_camera_moved(moved_mm):
    """The camera stood elsewhere in every picture: the touched one, the one now, and all between."""
    sim = cell(Exact, 9, moved_mm, touch_sigma_mm=0.0)
    recording = sim.record(wrists=mixed(sim))
    solution = solution_of(calibrate_joint(recording, arm=EXACT))
    object_from_tag_b = solution.base_from_object.inverse() @ (
        solution.base_from_camera @ solution.camera_from_tag_b
    )
    Y, tip = solution.wrist_from_tag_a, solution.tip_in_wrist
    touched = recording.touches[0].observation

    def equation_6(picture, point_in_object):
        tag_a, tag_b = picture.tag_a.camera_from_tag, picture.tag_b.camera_from_tag
        point = object_from_tag_b.inverse() @ point_in_object
        in_base = point_in_base_live(picture.base_from_wrist, Y, tag_a, tag_b, point)
        return flange_for(in_base, WORK_ROTATION, tip)

    for _ in range(3):
        request = sim.request()
        now, point = request.seen, sim.targets[request.target].point_in_object
        center = recording.facts.object.center_in_object
        seen = [
            picture.tag_a.camera_from_tag.inverse() @ picture.tag_b.camera_from_tag
            for picture in (touched, now)
        ]
        by_19 = special_expected(
            base_from_wrist_ref=touched.base_from_wrist,
            base_from_wrist_now=now.base_from_wrist,
            tag_a_from_tag_b_ref=seen[0],
            tag_a_from_tag_b_now=seen[1],
            R_wrist_from_tag_a=Y.rotation,
            pivot_in_tag_b=object_from_tag_b.inverse() @ center,
            flange_ref=equation_6(touched, point),
            pivot_flange_ref=equation_6(touched, center),
        )
        answered = answer(sim, solution, recording.facts, request).base_from_wrist.translation
        np.testing.assert_allclose(by_19, equation_6(now, point), atol=1e-6)
        np.testing.assert_allclose(answered, by_19, atol=1e-6)
        np.testing.assert_allclose(
            answered, sim.flange(request.target, request.angle_rad, WORK_ROTATION), atol=1e-6
        )


def test_a_hole_counts_in_the_place_of_the_touch_that_shows_the_object_alike():
    sim = cell(Exact, 10, 50.0, touch_sigma_mm=0.0)
    recording = sim.record(wrists=mixed(sim), names=[f"P{1 + i % 5}" for i in range(10)])
    seen = sim.holes([None], sigma_px=1e-3)
    last = len(recording.touches) - 1

    def cost(touch):
        holes = [HolePixel(hole.target, hole.pixel, 1e-3, touch=touch) for hole in seen]
        fit = calibrate_joint(recording, holes, arm=EXACT, robust=False, find_noise=False)
        return 2 * fit.cost / (2 * len(holes))

    assert cost(last) == cost(None) < 3
    assert cost(0) > 100
