"""Targets without CAD in the joint estimate: three unknowns each, told by their own touches alone."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.studies.robustness.bare_targets import without_cad
from fakes.world.noise import COARSE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.joint import (
    calibrate_joint,
    expected_by_joint,
    linearize,
    solution_of,
    whiten_arm,
)
from vgrd.calibration.joint.estimate import fit_as_if
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import JointState, layout_of
from vgrd.calibration.planning import (
    Job,
    PredictedError,
    Touching,
    advise_session,
    error_budget,
    errors_with_cad_mm,
)
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError, NotObservable
from vgrd.geometry import Pose
from vgrd.model import Policy, Stability, TaughtPoint, place_in

EVERY = tuple(f"P{i}" for i in range(1, 7))
BARE = ("P5", "P6")
TILT_RAD = np.radians(25)


def session(cell, names=EVERY, tilted=("P1", "P2", "P3", "P4"), bare=BARE, **options):
    """Each target once with the work orientation, then some with the wrist tilted."""
    wrists = [WORK_ROTATION] * len(names) + [cell.wrist(TILT_RAD) for _ in tilted]
    recording = cell.record(wrists=wrists, names=[*names, *tilted], **options)
    return without_cad(recording, bare)


def exact(seed):
    """A cell whose noise is next to nothing."""
    return Simulation(seed, vision=COARSE.finer(1e5), touch_sigma_mm=1e-6)


def true_state(cell, data):
    """The unknowns as they truly are, by the simulation's own numbers."""
    camera_from_base = cell.base_from_camera.inverse()
    base_from_object = cell.base_from_object(0.0)
    return JointState(
        cell.base_from_camera,
        cell.wrist_from_tag_a,
        np.array(cell.tcp_in_wrist),
        base_from_object,
        camera_from_base @ base_from_object @ cell.object_from_tag_b,
        camera_from_base @ base_from_object,
        np.array([[0, 0, cell.spin_angles[int(n.split()[1]) - 1]] for n in spin_names(data)]),
        np.zeros(3),
        bare_in_base=np.array([cell.point(name, 0.0) for name in data.bare]).reshape(-1, 3),
    )


def spin_names(data):
    return next(names for kind, names in data.names.items() if kind.value == "tag B in spins")


@pytest.mark.parametrize("bare", [BARE, EVERY], ids=["mixed", "none in CAD"])
def test_derivatives_are_those_of_the_residuals(bare):
    data = gather(session(Simulation(5), bare=bare))
    layout, state = layout_of(data), guess(data)
    assert layout.bare == bare
    J = linearize(state, data, layout)[1]
    step, numeric = 1e-5, np.zeros_like(J)
    for k in range(layout.size):
        d = np.zeros(layout.size)
        d[k] = step
        ahead, behind = (linearize(state.retract(s * d, layout), data, layout)[0] for s in (1, -1))
        numeric[:, k] = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(J, numeric, rtol=1e-5, atol=1e-4 * np.abs(J).max())
    own = J[:, layout.bare_columns().ravel()]
    np.testing.assert_allclose(own, numeric[:, layout.bare_columns().ravel()], atol=1e-5)
    assert (np.abs(own).sum(axis=0) > 0).all()


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("bare", [BARE, EVERY], ids=["mixed", "none in CAD"])
def test_perfect_samples_give_the_truth(bare, policy):
    cell = exact(7)
    tilted = ("P1", "P2", "P3", "P4") if bare == BARE else ("P2",) * 4
    recording = session(cell, tilted=tilted, bare=bare)
    calibration = calibrate_system(recording, policy=policy)
    assert calibration.verdict.ok
    for name in EVERY:
        request = replace(cell.request(), target=name)
        expected = expected_coordinate(calibration, name, request.seen.tag_b, policy)
        tip = expected.base_from_wrist @ cell.tcp_in_wrist
        np.testing.assert_allclose(tip, cell.point(name, request.angle_rad), atol=2e-3)
        placed = calibration.solution.in_tag_b(recording.facts, calibration.taught[name])
        true = cell.object_from_tag_b.inverse() @ cell.targets[name].cad
        np.testing.assert_allclose(placed.in_tag_b, true, atol=2e-3)


def test_a_wrist_that_only_yaws_serves_an_object_without_cad():
    cell = Simulation(8, vision=COARSE.finer(1e5), touch_sigma_mm=1e-6, one_axis=True)
    recording = session(cell, tilted=("P2",) * 4, bare=EVERY)
    calibration = calibrate_system(recording)
    request = replace(cell.request(), target="P4")
    expected = expected_coordinate(calibration, "P4", request.seen.tag_b, Policy.FIXED)
    tip = expected.base_from_wrist @ cell.tcp_in_wrist
    np.testing.assert_allclose(tip, cell.point("P4", request.angle_rad), atol=5e-3)
    assert calibration.tcp is None
    assert calibration.solution.in_tag_b(recording.facts, calibration.taught["P4"]) is None


def test_what_is_stated_is_the_cramer_rao_bound_at_the_truth():
    cell = Simulation(9, vision=COARSE, touch_sigma_mm=0.05)
    data = gather(session(cell))
    truth = true_state(cell, data)
    bound = fit_as_if(data, truth)
    J, layout = (
        whiten_arm(bound.arm_factor, linearize(truth, data, layout_of(data))[1]),
        layout_of(data),
    )
    directly = np.linalg.inv(J.T @ J)
    stated = calibrate_joint(
        session(Simulation(9, vision=COARSE, touch_sigma_mm=0.05)),
        robust=False,
        find_noise=False,
    )
    for columns in (*layout.bare_columns(), np.arange(27)[layout.TCP]):
        part = np.ix_(columns, columns)
        np.testing.assert_allclose(bound.covariance[part], directly[part], rtol=1e-4)
        sigmas = np.sqrt(np.diag(stated.covariance[part]) / stated.variance_scale)
        np.testing.assert_allclose(sigmas, np.sqrt(np.diag(directly[part])), rtol=0.05)


def test_errors_scatter_as_the_covariance_says():
    squares = []
    for seed in range(24):
        cell = Simulation(300 + seed)
        recording = session(cell)
        solution = solution_of(calibrate_joint(recording, robust=False, find_noise=False))
        target = recording.facts.object.targets["P5"]
        taught = TaughtPoint(target, np.zeros(3), np.eye(3), np.eye(3))
        placed = solution.in_tag_b(recording.facts, taught)
        off = placed.in_tag_b - cell.object_from_tag_b.inverse() @ cell.targets["P5"].cad
        squares.append(off @ np.linalg.solve(placed.covariance, off))
    assert 45 < sum(squares) < 108  # chi2 of 72 degrees of freedom, 99 %


def test_one_touch_tells_nothing_but_its_own_target():
    recording = session(Simulation(11))
    blunt = replace(
        recording,
        touches=tuple(
            replace(t, lateral_sigma_mm=2.0, axial_sigma_mm=3.0) if t.target in BARE else t
            for t in recording.touches
        ),
    )
    sharp_fit, blunt_fit = (
        calibrate_joint(r, robust=False, find_noise=False) for r in (recording, blunt)
    )
    others = np.arange(27)
    part = np.ix_(others, others)
    scale = np.sqrt(np.diag(sharp_fit.covariance[part]))
    difference = sharp_fit.covariance[part] / sharp_fit.variance_scale
    difference = difference - blunt_fit.covariance[part] / blunt_fit.variance_scale
    assert np.abs(difference / np.outer(scale, scale)).max() < 1e-6
    assert np.linalg.norm(sharp_fit.state.tcp_in_wrist - blunt_fit.state.tcp_in_wrist) < 1e-5


def test_touches_of_one_target_with_the_wrist_tilted_tell_the_tcp():
    once = session(Simulation(12), tilted=(), bare=EVERY)
    again = session(Simulation(12), tilted=("P3",) * 4, bare=EVERY)
    assert solution_of(calibrate_joint(once)).tcp is None
    tcp = solution_of(calibrate_joint(again)).tcp
    error = tcp.in_wrist - Simulation(12).tcp_in_wrist
    assert np.linalg.norm(error) < 4 * np.sqrt(np.trace(tcp.covariance)) < 6.0


def test_a_bad_touch_of_a_target_touched_often_is_left_out():
    recording = session(Simulation(13), names=[*EVERY, "P5", "P5", "P5"])
    off = Pose(np.eye(3), np.array([4.0, 0, 0]))
    bad = replace(recording.touches[6], base_from_wrist=off @ recording.touches[6].base_from_wrist)
    touches = (*recording.touches[:6], replace(bad, observation=None), *recording.touches[7:])
    fit = calibrate_joint(replace(recording, touches=touches))
    left_out = [s.name for s in fit.samples if not s.used]
    assert left_out == ["touch 7 (P5)"]


def test_an_untouched_target_is_named_and_the_others_are_served():
    recording = session(Simulation(14), names=EVERY[:5])
    calibration = calibrate_system(recording)
    assert calibration.verdict.ok
    (finding,) = [f for f in calibration.verdict.findings if f.code == "target_untouched"]
    assert "touch P6" in finding.message
    assert sorted(calibration.taught) == list(EVERY[:5])
    seen = Simulation(14).observe(Simulation.standing, 0.3).tag_b
    with pytest.raises(InputError, match="'P6' was not taught"):
        expected_coordinate(calibration, "P6", seen, Policy.FIXED)
    with pytest.raises(NotObservable, match="'P6' has no point_mm and was not touched"):
        calibration.solution.taught_place(recording.facts.object.targets["P6"])
    advice = advise_session(recording).to_json()
    assert advice["next"]["words"].startswith("touch P6")
    assert "P6" not in advice["predicted_u95_mm"]


def test_an_object_without_cad_and_one_wrist_is_refused_with_what_to_add():
    recording = session(Simulation(15), tilted=(), bare=EVERY)
    with pytest.raises(NotObservable, match=r"depends on the TCP.*one and the same three times"):
        calibrate_system(recording)
    codes = {f.code: f for f in advise_session(recording).findings}
    assert codes["wrist_tilt"].fatal
    assert "again" in codes["wrist_tilt"].message
    assert calibrate_system(recording, policy=Policy.FOLLOW).verdict.ok


def test_the_advice_foretells_what_cad_brings():
    cell = Simulation(16)
    recording = session(cell)
    in_cad = replace(recording, facts=cell.facts())
    job = Job(angles_rad=(0.0, 2.0))
    foretold = errors_with_cad_mm(calibrate_joint(recording), job)
    served = calibrate_joint(in_cad)
    advice = advise_session(recording).to_json()
    for name in BARE:
        brought = advise_session(in_cad).predicted_mm[name]
        told = advice["without_cad"][name]
        assert foretold[name] == pytest.approx(brought, rel=0.05 + served.variance_scale - 1)
        assert told["u95_with_cad_mm"] == pytest.approx(foretold[name])
        assert told["u95_mm"] == advice["predicted_u95_mm"][name] > 1.5 * foretold[name]
        assert f"{told['u95_mm']:.3f} mm, {told['u95_with_cad_mm']:.3f} mm" in told["words"]
    assert set(advice["without_cad"]) == set(BARE)


def test_what_a_second_touch_brings_is_foretold():
    once = calibrate_joint(session(Simulation(17)), robust=False, find_noise=False)
    names = [*EVERY, "P5"]
    twice = calibrate_joint(session(Simulation(17), names=names), robust=False, find_noise=False)
    job = Job(angles_rad=(0.0, 2.0), targets=("P5",))
    foresight = PredictedError(once, job)
    (rows,) = foresight.rows([Touching("P5", WORK_ROTATION)])
    before_mm = foresight.error_mm(foresight.covariance)
    foretold_mm = foresight.error_mm(foresight.with_rows(foresight.covariance, rows))
    came_mm = PredictedError(twice, job).error_mm(twice.covariance)
    assert came_mm < 0.85 * before_mm
    assert foretold_mm / once.variance_scale**0.5 == pytest.approx(
        came_mm / twice.variance_scale**0.5, rel=0.03
    )


def test_the_error_budget_of_a_bare_target_adds_up():
    cell = Simulation(18)
    fit = calibrate_joint(session(cell))
    request = cell.request()
    budget = error_budget(fit, request.seen.tag_b, targets=("P1", "P5"))
    for name, u95_mm in zip(budget.targets, budget.u95_mm, strict=True):
        answer = expected_by_joint(fit, name, request.seen)
        assert u95_mm == pytest.approx(answer.u95_mm, rel=0.02)
    touches = [row["touches"] for row in budget.rows()]
    assert touches[1] > touches[0]


def test_a_camera_that_people_move_teaches_them_as_well():
    cell = Simulation(19, vision=COARSE.finer(1e5), touch_sigma_mm=1e-6)
    recording = session(cell)
    movable = replace(recording.facts, camera_stability=Stability.MOVABLE)
    calibration = calibrate_system(replace(recording, facts=movable))
    request = replace(cell.request(), target="P6")
    place = place_in(request.seen, Stability.MOVABLE)
    expected = expected_coordinate(
        calibration, "P6", request.seen.tag_b, Policy.FIXED, camera=place
    )
    tip = expected.base_from_wrist @ cell.tcp_in_wrist
    np.testing.assert_allclose(tip, cell.point("P6", request.angle_rad), atol=5e-3)


def test_two_touches_that_contradict_each_other_are_not_served():
    recording = session(Simulation(13), names=[*EVERY, "P5"])
    off = Pose(np.eye(3), np.array([2.0, 0, 0]))
    last = recording.touches[6]
    bad = replace(last, base_from_wrist=off @ last.base_from_wrist, observation=None)
    touches = (*recording.touches[:6], bad, *recording.touches[7:])
    verdict = calibrate_system(replace(recording, touches=touches)).verdict
    fatal = [finding.code for finding in verdict.findings if finding.fatal]
    assert fatal == ["target_contradicted"]
    codes = [f.code for f in advise_session(replace(recording, touches=touches)).findings]
    assert "target_contradicted" in codes
    assert calibrate_system(recording).verdict.ok
