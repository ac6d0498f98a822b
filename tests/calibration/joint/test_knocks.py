"""A fixed camera that was knocked while it was taught: found, named and followed."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fakes.studies.sessions import known_arm
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import FINE
from fakes.world.simulation import Simulation
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.fit import fit_joint
from vgrd.calibration.joint.knocks import as_seen_in_the_end, moves_of, squares_of, suspicion
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import layout_of
from vgrd.calibration.planning.advice import advise_session
from vgrd.calibration.solve import calibrate_system
from vgrd.geometry import Pose
from vgrd.model import ArmModel

ARM = ArmErrors(sigma_mm=0.03, field_mm=0.15)
EXACT = ArmModel()
LOOKS, SPINS = 8, 10  # as `Simulation.record`


class Knocked(Simulation):
    """The camera is moved by so many mm and mrad before the pictures of `knocks`, counted from 0."""

    def __init__(self, seed, knocks, **options):
        super().__init__(seed, vision=FINE, center_sigma_mm=0.02, **options)
        self.knocks, self.count = knocks, 0

    def spins(self, count):
        angles = np.linspace(0, 1.6 * np.pi, count)
        return tuple(self.observe(self.standing, float(angle)) for angle in angles)

    def observe(self, *arguments, **options):
        if mm := self.knocks.get(self.count, 0.0):
            self.base_from_camera = self.base_from_camera @ displacement(self.rng, mm)
        self.count += 1
        return super().observe(*arguments, **options)


def displacement(rng, moved_mm):
    shift, turn = rng.normal(size=(2, 3))
    shift, turn = shift / np.linalg.norm(shift), turn / np.linalg.norm(turn)
    return Pose.exp(moved_mm * np.concatenate([shift, 1e-3 * turn]))


def taught(seed, knocks, **options):
    sim = Knocked(seed, knocks, arm=ARM)
    wrists = [sim.wrist()] * 6 + [sim.wrist(np.radians(25)) for _ in range(4)]
    return sim, sim.record(wrists=wrists, **options)


solved = partial(calibrate_joint, arm=known_arm(ARM))


@pytest.mark.ordered("names of samples are part of what is expected")
@pytest.mark.parametrize(
    ("before", "names"),
    [
        (4, ("look 4", "look 5")),
        (LOOKS, ("look 8", "spin 1")),
        (LOOKS + SPINS + 5, ("touch 5 (P5)", "touch 6 (P6)")),
    ],
)
@pytest.mark.parametrize("moved_mm", [0.3, 5.0, 300.0])
def test_a_knock_is_found_where_it_was_and_followed(moved_mm, before, names):
    sim, recording = taught(7, {before: moved_mm})
    fit = solved(recording)
    (move,) = moves_of(fit)
    assert (move.before, move.after) == names
    assert move.mm == pytest.approx(moved_mm, abs=0.1 + 5e-3 * moved_mm)
    assert 1e3 * move.rad == pytest.approx(moved_mm, abs=0.15)
    mm, rad = fit.state.base_from_camera.distance(sim.base_from_camera)
    assert mm < 0.5
    assert rad < 5e-4
    assert all(sample.used for sample in fit.samples)
    assert fit.noise_scale < 1.2


def test_two_knocks_are_found():
    sim, recording = taught(8, {3: 1.0, LOOKS + SPINS + 3: 2.0})
    fit = solved(recording)
    assert [round(move.mm) for move in moves_of(fit)] == [1, 2]
    mm, _ = fit.state.base_from_camera.distance(sim.base_from_camera)
    assert mm < 0.5


def test_the_squares_of_a_suspicion_are_those_by_which_the_cost_falls():
    _, recording = taught(9, {LOOKS + 4: 0.2})
    stamp = recording.spins[4].stamp_s
    costs = []
    for moves_s in ((), (stamp,)):
        data = gather(recording, arm=EXACT, moves_s=moves_s)
        costs.append(fit_joint(data, layout_of(data), guess(data)))
    squares, freedoms = squares_of(costs[0], np.array([stamp]))
    assert freedoms.tolist() == [6]
    assert squares[0] == pytest.approx(2 * (costs[0].cost - costs[1].cost), rel=1e-3)


def test_good_sessions_are_not_suspected_and_their_squares_are_those_of_chance():
    means = []
    for seed in range(40):
        _, recording = taught(100 + seed, {})
        fit = solved(recording, robust=False)
        assert suspicion(fit) is None
        middle = np.array([recording.spins[5].stamp_s, recording.touches[4].observation.stamp_s])
        means.append(squares_of(fit, middle)[0].mean())
    assert np.mean(means) == pytest.approx(6, abs=1.2)


def test_a_bad_sample_is_no_knock():
    _, recording = taught(10, {})
    off = Pose.exp(np.array([2.0, 0, 0, 0, 2e-3, 0]))

    def slipped(picture):
        tag = replace(picture.tag_a, camera_from_tag=picture.tag_a.camera_from_tag @ off)
        return replace(picture, tag_a=tag)

    first = replace(recording, looks=(slipped(recording.looks[0]), *recording.looks[1:]))
    middle = recording.touches[4]
    middle = replace(middle, observation=slipped(middle.observation))
    inside = replace(recording, touches=(*recording.touches[:4], middle, *recording.touches[5:]))
    for spoilt, stamp in ((first, 5.0), (inside, middle.observation.stamp_s)):
        fit = solved(spoilt)
        assert not moves_of(fit)
        left_out = [sample for sample in fit.samples if not sample.used]
        assert [sample.kind for sample in left_out] == ["tag A"], stamp


@pytest.mark.parametrize("tag_a", [True, False])
def test_an_object_that_moved_is_no_knock(tag_a):
    sim, recording = taught(11, {})
    touches = []
    for i, touch in enumerate(recording.touches):
        sim.center_in_base = Simulation.center_in_base + np.array([3.0, 0, 0]) * (i > 5)
        touches.append(sim.touch(touch.target, touch.base_from_wrist.rotation, tag_a=tag_a))
    moved = replace(recording, touches=tuple(touches))
    calibration = calibrate_system(moved)
    codes = {remark.code for remark in calibration.verdict.findings if remark.fatal}
    assert "object_moved" in codes
    assert not moves_of(solved(moved))


def test_the_order_of_the_samples_does_not_matter():
    _, recording = taught(12, {LOOKS + SPINS + 4: 1.0})
    backwards = replace(
        recording,
        looks=recording.looks[::-1],
        spins=recording.spins[::-1],
        touches=recording.touches[::-1],
    )
    a, b = solved(recording), solved(backwards)
    assert a.data.places.first_s == b.data.places.first_s != ()
    np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.ordered("names of samples are part of what is expected")
def test_the_verdict_says_when_the_camera_moved_and_nothing_else():
    sim, recording = taught(13, {LOOKS + SPINS + 5: 2.0})
    calibration = calibrate_system(recording)
    assert calibration.verdict.ok
    remarks = {remark.code: remark.message for remark in calibration.verdict.findings}
    assert set(remarks) == {"flange_not_proven", "camera_moved"}
    assert "between touch 5 (P5) and touch 6 (P6)" in remarks["camera_moved"]
    assert remarks["camera_moved"].endswith("fasten it")
    assert calibration.base_from_camera.distance(sim.base_from_camera)[0] < 0.5


def test_the_coach_tells_of_a_knock_and_goes_on():
    _, recording = taught(13, {LOOKS + SPINS + 5: 2.0})
    advice = advise_session(recording)
    assert {remark.code for remark in advice.findings} == {"camera_moved"}
    assert not advice.trouble
    assert len(advice.predicted_mm) == 6


def test_a_recording_is_told_as_seen_from_the_place_in_the_end():
    _, recording = taught(14, {LOOKS + SPINS + 5: 5.0})
    fit = solved(recording)
    seen = as_seen_in_the_end(fit, recording)
    again = solved(seen)
    assert not moves_of(again)
    mm, rad = again.state.base_from_camera.distance(fit.state.base_from_camera)
    assert mm < 0.2
    assert rad < 2e-4
