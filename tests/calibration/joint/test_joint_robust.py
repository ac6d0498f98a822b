from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import FINE
from fakes.world.simulation import Simulation
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.joint.fit import fit_joint
from vgrd.calibration.joint.problem import SAMPLED, EvidenceKind, HolePixel
from vgrd.calibration.joint.robust import leave_one_out, touch_misses
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import layout_of
from vgrd.geometry import Pose
from vgrd.model import ArmModel

EXACT = ArmModel()
FIELD = ArmModel(0.03, 0.15, rad_per_mm=0.75e-3)
TILT = np.radians(25)


def taught(seed, touches=8, tilted=4, **options):
    sim = Simulation(seed, **options)
    wrists = [sim.wrist()] * (touches - tilted) + [sim.wrist(TILT) for _ in range(tilted)]
    return sim, sim.record(wrists=wrists)


def shifted(pose, shift):
    return Pose(pose.rotation, pose.translation + np.asarray(shift))


def with_sample(recording, kind, index, **changes):
    samples = list(getattr(recording, kind))
    samples[index] = replace(samples[index], **changes)
    return replace(recording, **{kind: tuple(samples)})


def off(recording, index, shift):
    pose = shifted(recording.touches[index].base_from_wrist, shift)
    return with_sample(recording, "touches", index, base_from_wrist=pose)


def named(result, kind=None):
    return {s.name for s in result.samples if not s.used and kind in (None, s.kind)}


def mean_miss(sim, result, requests):
    return np.mean(
        [
            np.linalg.norm(
                sim.miss(r, expected_by_joint(result, r.target, r.seen).base_from_wrist)
            )
            for r in requests
        ]
    )


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_a_touch_off_by_2_mm_is_named_and_does_not_spoil_the_coordinate():
    clean, kept, spoilt = [], [], []
    for seed in range(10):
        sim, recording = taught(500 + seed)
        bad = int(sim.rng.integers(8))
        direction = sim.rng.normal(size=3)
        blundered = off(recording, bad, 2 * direction / np.linalg.norm(direction))
        result = calibrate_joint(blundered, arm=EXACT)
        assert {int(name.split()[1]) - 1 for name in named(result)} == {bad}
        requests = [sim.request() for _ in range(3)]
        for found, from_ in (
            (clean, calibrate_joint(recording, arm=EXACT)),
            (kept, result),
            (spoilt, calibrate_joint(blundered, arm=EXACT, robust=False)),
        ):
            found.append(mean_miss(sim, from_, requests))
    assert np.mean(kept) <= 1.3 * np.mean(clean)
    assert np.mean(spoilt) > 1.5 * np.mean(clean)


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_two_bad_touches_do_not_hide_each_other():
    for seed in range(3):
        _, recording = taught(520 + seed, touches=10, tilted=5)
        both = off(off(recording, 1, (2.0, 0, 0)), 6, (1.6, 1.6, 0))
        result = calibrate_joint(both, arm=EXACT)
        assert named(result) == {"touch 2 (P2)", "touch 7 (P1)"}


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_bad_pictures_are_named_and_the_touches_keep_their_weight():
    sim, recording = taught(530)
    turn = Pose.from_rotvec((0.0, 0.02, 0.0), (0.0, 0.0, 0.0))
    look, spin = recording.looks[3], recording.spins[5]
    seen = replace(look.tag_a, camera_from_tag=look.tag_a.camera_from_tag @ turn)
    slipped = shifted(spin.tag_b.camera_from_tag, (1.0, 0.0, 0.0))
    spoilt = with_sample(recording, "looks", 3, tag_a=seen)
    spoilt = with_sample(spoilt, "spins", 5, tag_b=replace(spin.tag_b, camera_from_tag=slipped))
    result = calibrate_joint(spoilt, arm=EXACT)
    assert named(result, "tag A") == {"look 4"}
    assert named(result, "tag B in spins") == {"spin 6"}
    assert named(result) == {"look 4", "spin 6"}
    assert all("sigma off" in s.reason for s in result.samples if not s.used)
    requests = [sim.request() for _ in range(4)]
    clean = calibrate_joint(recording, arm=EXACT)
    assert mean_miss(sim, result, requests) < 1.1 * mean_miss(sim, clean, requests)


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_a_hole_read_in_the_wrong_place_is_named():
    sim, recording = taught(531)
    holes = [HolePixel(h.target, h.pixel, h.sigma_px, h.spin) for h in sim.holes([None, 3])]
    holes[8] = replace(holes[8], pixel=holes[8].pixel + np.array([3.0, 0.0]))
    result = calibrate_joint(recording, holes, arm=EXACT)
    assert named(result) == {f"hole {holes[8].target} in spin 4"}


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_holes_of_a_spin_that_is_left_out_go_with_it():
    sim, recording = taught(532)
    holes = [HolePixel(h.target, h.pixel, h.sigma_px, h.spin) for h in sim.holes([2, 5, 6])]
    data = gather(recording, holes, EXACT)
    weights = {link: np.ones(len(data.names[link])) for link in SAMPLED}
    weights[EvidenceKind.SPINS][list(data.names[EvidenceKind.SPINS]).index("spin 6")] = 0
    left = data.weighted(weights)
    kept = [data.names[EvidenceKind.HOLES].index(name) for name in left.names[EvidenceKind.HOLES]]
    assert len(kept) == 12
    for i, k in enumerate(kept):
        np.testing.assert_array_equal(left.holes.pixels[i], data.holes.pixels[k])
        spin = data.names[EvidenceKind.SPINS][data.holes.spin[k]]
        assert left.names[EvidenceKind.SPINS][left.holes.spin[i]] == spin


@pytest.mark.parametrize("arm", [EXACT, FIELD])
def test_a_clean_session_keeps_every_sample_and_loses_nothing(arm):
    for seed in range(4):
        _, recording = taught(540 + seed)
        result, plain = (
            calibrate_joint(recording, arm=arm, robust=robust, find_noise=False)
            for robust in (True, False)
        )
        assert not named(result)
        np.testing.assert_array_equal(result.covariance, plain.covariance)
        np.testing.assert_array_equal(result.state.tcp_in_wrist, plain.state.tcp_in_wrist)


@pytest.mark.parametrize("arm", [EXACT, FIELD])
def test_scores_are_what_leaving_a_sample_out_says(arm):
    """Squared distance of a touch from the fit without it, by the covariance of both."""
    _, recording = taught(550, vision=FINE)
    data = gather(recording, (), arm)
    whole = fit_joint(data, layout_of(data), guess(data))
    scores = leave_one_out(whole)[EvidenceKind.TOUCHES].scores
    weights = {link: np.ones(len(data.names[link])) for link in SAMPLED}
    weights[EvidenceKind.TOUCHES][2] = 0
    left = data.weighted(weights)
    without = fit_joint(left, layout_of(left), whole.state)
    gained = 2 * (whole.report.cost - without.report.cost)
    cubic = ((gained / 3) ** (1 / 3) - (1 - 2 / 27)) / np.sqrt(2 / 27)
    assert scores[2] == pytest.approx(max(cubic, 0), abs=0.02)


@pytest.mark.exact("what differs in its last digits is sorted and rounded otherwise")
@pytest.mark.parametrize("arm", [EXACT, FIELD])
def test_samples_in_any_order_give_the_same_to_the_last_bit(arm):
    sim, recording = taught(560)
    recording = off(recording, 5, (0.0, 2.5, 0.0))
    shuffled = replace(
        recording,
        **{
            kind: tuple(getattr(recording, kind)[i] for i in sim.rng.permutation(count))
            for kind, count in (("looks", 8), ("touches", 8), ("spins", 10))
        },
    )
    a, b = calibrate_joint(recording, arm=arm), calibrate_joint(shuffled, arm=arm)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    np.testing.assert_array_equal(a.state.tcp_in_wrist, b.state.tcp_in_wrist)
    request = sim.request()
    poses = [expected_by_joint(r, request.target, request.seen).base_from_wrist for r in (a, b)]
    np.testing.assert_array_equal(poses[0].translation, poses[1].translation)
    assert len(named(a)) == len(named(b)) == 1


def test_a_slipped_spin_is_left_out_with_the_holes_that_it_shows():
    sim, recording = taught(533)
    holes = [HolePixel(h.target, h.pixel, h.sigma_px, h.spin) for h in sim.holes([2, 5])]
    spins = list(recording.spins)
    tag = spins[5].tag_b
    slipped = Pose.exp(np.array([2.0, 1.0, 0, 0, 0, 0])) @ tag.camera_from_tag
    spins[5] = replace(spins[5], tag_b=replace(tag, camera_from_tag=slipped))
    result = calibrate_joint(replace(recording, spins=tuple(spins)), holes, arm=EXACT)
    unused = {sample.name for sample in result.samples if not sample.used}
    assert "spin 6" in unused
    assert {f"hole {h.target} in spin 6" for h in holes if h.spin == 5} <= unused


def test_each_touch_tells_how_far_it_is_off_and_from_where_the_others_put_it():
    _, recording = taught(3, touch_sigma_mm=0.1)
    names = [f"touch {i + 1} ({touch.target})" for i, touch in enumerate(recording.touches)]
    misses = by_name(recording)
    assert sorted(misses) == names
    assert all(miss.reason == "" for miss in misses.values())
    assert all(0 < miss.off_mm <= miss.left_out_mm for miss in misses.values())  # leverage below 1
    shift_mm = 0.3
    again = by_name(off(recording, 1, (0, 0, shift_mm)))[names[1]]
    assert again.left_out_mm == pytest.approx(shift_mm, abs=3 * 0.1)  # its own noise
    bad = by_name(off(recording, 1, (5.0, 0, 0)))[names[1]]
    assert (bad.off_mm, bad.left_out_mm) == (None, None)
    assert "sigma off" in bad.reason


def by_name(recording):
    return {miss.name: miss for miss in touch_misses(calibrate_joint(recording))}
