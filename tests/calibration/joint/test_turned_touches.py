"""Touches of the object while it is turned on its table: they tell where its centre is."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import COARSE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.joint import calibrate_joint, linearize
from vgrd.calibration.joint.rows import touched_places
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import layout_of
from vgrd.calibration.planning import Job, PredictedError
from vgrd.calibration.planning.next_sample import next_best
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.touches import turned_touches
from vgrd.geometry import Pose
from vgrd.model import Plan, Policy, Stability, place_in

NAMES = ("P1", "P3", "P5", "P2", "P4", "P6", "P1", "P3")
TURNS_RAD = (0.0,) * 4 + (np.pi,) * 4
USUAL_CENTER_MM = 0.2


def session(cell, turns_rad=TURNS_RAD, **options):
    wrists = [WORK_ROTATION] * len(NAMES)
    return cell.record(wrists=wrists, names=NAMES, turns_rad=turns_rad, **options)


def stating(recording, sigma_mm, off_mm=(0.0, 0.0, 0.0)):
    """The same with another centre in its cell file."""
    spec = recording.facts.object
    center = np.asarray(spec.center_in_object) + off_mm
    spec = replace(spec, center_in_object=center, center_sigma_mm=sigma_mm)
    return replace(recording, facts=replace(recording.facts, object=spec))


def codes(calibration):
    return {finding.code for finding in calibration.verdict.findings}


def exact(seed):
    """A cell whose noise is next to nothing."""
    return Simulation(seed, vision=COARSE.finer(1e5), touch_sigma_mm=1e-6)


def test_derivatives_are_those_of_the_residuals():
    data = gather(session(Simulation(1), turns_rad=(0, 0, 0, 0.5, 0.5, 2, 2, -1)))
    layout, state = layout_of(data), guess(data)
    assert sorted(data.touch_spins) == [-1, -1, -1, 10, 11, 12, 13, 14]
    J = linearize(state, data, layout)[1]
    rows = data.rows_of(next(kind for kind in data.counts if kind.value == "touches"))
    step = 1e-6
    for k in range(layout.size):
        change = step * np.eye(layout.size)[k]
        ahead, behind = (
            linearize(state.retract(sign * change, layout), data, layout)[0][rows]
            for sign in (1, -1)
        )
        numeric = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(J[rows, k], numeric, atol=1e-5 * np.abs(J[rows]).max())


def test_the_first_guess_puts_every_target_where_it_is():
    cell = exact(2)
    data = gather(session(cell))
    state = guess(data)
    names = [name.split("(")[1][:2] for name in data.names[list(data.counts)[1]]]
    turned = data.touch_spins >= 0
    truth = [cell.point(n, np.pi if t else 0.0) for n, t in zip(names, turned, strict=True)]
    assert turned.sum() == 4
    places = touched_places(state, data) - truth
    np.testing.assert_allclose(places[:, :2], 0, atol=0.5)
    np.testing.assert_allclose(places[:, 2], places[0, 2], atol=0.5)  # with one tilt it is open


@pytest.mark.parametrize(
    ("turns_rad", "cost"), [(TURNS_RAD, 1.35), ((0, 0, 0, 0.8, 0.8, 1.6, 1.6, 2.4), 1.6)]
)
def test_an_unknown_centre_costs_little_where_the_object_was_turned(turns_rad, cost):
    cell = Simulation(3)
    recording = session(cell, turns_rad=turns_rad)
    known, unknown = (calibrate_system(stating(recording, sigma_mm)) for sigma_mm in (0.02, 5.0))
    least = known.residuals["predicted_u95_mm"]
    assert unknown.residuals["predicted_u95_mm"] < cost * least
    at_rest = session(Simulation(3), turns_rad=None)
    open_mm = calibrate_system(stating(at_rest, 5.0)).residuals["predicted_u95_mm"]
    assert open_mm > 3 * least


def test_a_wrong_centre_is_named_and_does_no_harm():
    within = []
    for seed in range(6):
        cell = Simulation(100 + seed)
        recording = stating(session(cell), USUAL_CENTER_MM, (0.8, -0.6, 0.0))
        calibration = calibrate_system(recording)
        assert "center_off" in codes(calibration)
        for _ in range(5):
            asked = cell.request()
            place = place_in(asked.seen, Stability.FIXED)
            told = expected_coordinate(
                calibration, asked.target, asked.seen.tag_b, Policy.FIXED, WORK_ROTATION, place
            )
            miss_mm = np.linalg.norm(cell.miss(asked, told.base_from_wrist))
            within.append(miss_mm <= told.u95_mm)
    assert np.mean(within) > 0.85


def test_no_spin_is_needed_where_the_touches_turn():
    cell = exact(4)
    recording = session(cell, turns_rad=(0, 0, 0, 1.5, 1.5, 3, 3, 3), spins=0)
    calibration = calibrate_system(recording)
    asked = cell.request()
    place = place_in(asked.seen, Stability.FIXED)
    told = expected_coordinate(
        calibration, asked.target, asked.seen.tag_b, Policy.FIXED, WORK_ROTATION, place
    )
    assert np.linalg.norm(cell.miss(asked, told.base_from_wrist)) < 0.01


def test_a_tag_taken_for_its_mirror_image_is_no_turn():
    recording = session(Simulation(5), turns_rad=None)
    flip = Pose.from_rotvec((0.6, 0, 0), (0, 0, 0))
    touches = list(recording.touches)
    seen = touches[2].observation
    pose = seen.tag_b.camera_from_tag @ flip
    tag_b = replace(seen.tag_b, camera_from_tag=pose)
    touches[2] = replace(touches[2], observation=replace(seen, tag_b=tag_b))
    assert turned_touches(replace(recording, touches=tuple(touches))) == ()


def test_a_turn_off_the_axis_is_left_out_with_its_touch():
    cell = Simulation(6)
    recording = session(cell)
    touches = list(recording.touches)
    seen = touches[5].observation
    pose = Pose.from_rotvec((0, 0, 0), (3, 0, 0)) @ seen.tag_b.camera_from_tag
    tag_b = replace(seen.tag_b, camera_from_tag=pose)
    touches[5] = replace(touches[5], observation=replace(seen, tag_b=tag_b))
    fit = calibrate_joint(replace(recording, touches=tuple(touches)))
    left_out = {sample.kind: sample for sample in fit.samples if not sample.used}
    assert left_out.keys() == {"tag B in spins", "touches"}
    assert left_out["touches"].name == "touch 6 (P6)"
    assert "turn of the object" in left_out["touches"].reason


def test_a_plan_of_the_paper_keeps_the_object_where_it_is():
    recording = session(Simulation(7), plan=Plan.SPECIAL)
    assert turned_touches(recording) == ()
    calibration = calibrate_system(recording)
    assert "object_moved" in codes(calibration)
    assert not calibration.verdict.ok


def test_a_touch_of_the_turned_object_is_advised_and_brings_what_is_foretold():
    cell = Simulation(9)
    wrists, names = [WORK_ROTATION] * 6, [f"P{i}" for i in range(1, 7)]
    at_rest = stating(cell.record(wrists=wrists, names=names), USUAL_CENTER_MM)
    fit = calibrate_joint(at_rest, find_noise=False, robust=False)
    best = next_best(fit, Job(angles_rad=(0.0, 2.0)))[0]
    assert best.candidate.turn_rad == pytest.approx(np.pi)
    assert best.base_from_wrist is None
    assert best.sentence.startswith("turn the object to 180 degrees and touch P")
    again = cell.touch(best.candidate.target, WORK_ROTATION, np.pi)
    more = replace(at_rest, touches=(*at_rest.touches, again))
    came = calibrate_joint(more, find_noise=False, robust=False)
    came_mm = PredictedError(came, Job(angles_rad=(0.0, 2.0))).error_mm(came.covariance)
    foretold_mm = best.after_mm * (came.variance_scale / fit.variance_scale) ** 0.5
    assert came_mm < 0.8 * best.before_mm
    assert foretold_mm == pytest.approx(came_mm, rel=0.05)


@pytest.mark.exact("another order of the samples is the same evidence to the last bit")
def test_the_order_of_the_samples_does_not_count():
    recording = session(Simulation(8))
    other = replace(recording, touches=recording.touches[::-1], spins=recording.spins[::-1])
    first, second = (calibrate_joint(one).state.tcp_in_wrist for one in (recording, other))
    np.testing.assert_array_equal(first, second)
