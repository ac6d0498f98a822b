import numpy as np
import pytest

from fakes.simulation import COARSE, Simulation
from vgrd.calibration.coaching import (
    Job,
    Looking,
    Spinning,
    Touching,
    next_best,
    plan_touches,
    tilted_touches,
)
from vgrd.calibration.joint import ArmModel, calibrate_joint
from vgrd.calibration.joint_expected import expected_by_joint
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import Policy

TILT = np.radians(30)


def session(seed=1, **options):
    sim = Simulation(seed, vision=COARSE)
    return sim, sim.record(**options)


def tilted(sim, fixed=3, tilted=3):
    return [sim.wrist()] * fixed + [sim.wrist(TILT) for _ in range(tilted)]


def tilt_of(touching, sim):
    return np.arccos(np.clip(touching.base_from_wrist[:, 2] @ sim.wrist()[:, 2], -1, 1))


def test_a_predicted_error_is_the_one_after_the_sample_was_taken():
    sim, recording = session(wrists=tilted(Simulation(1)))
    result = calibrate_joint(recording, arm=ArmModel(0.02))
    job = Job(targets=["P2"], angles_rad=[0.7])
    candidates = tilted_touches(result, TILT, targets=["P4"])[:3]
    for advice in next_best(result, candidates, job):
        touching = advice.candidate
        touch = sim.touch(touching.target, touching.base_from_wrist)
        more = type(recording)(
            session="more",
            plan=recording.plan,
            facts=recording.facts,
            looks=recording.looks,
            spins=recording.spins,
            touches=(*recording.touches, touch),
        )
        after = calibrate_joint(more, arm=ArmModel(0.02))
        again = next_best(after, candidates[:1], job)[0]
        assert advice.after_mm == pytest.approx(again.before_mm, rel=0.03)
        assert advice.after_mm < advice.before_mm


def test_a_fixed_wrist_wants_straight_touches_and_a_requested_one_wants_tilted_ones():
    sim, recording = session()
    result = calibrate_joint(recording)
    candidates = tilted_touches(result, TILT)
    fixed = next_best(result, candidates, Job(Policy.FIXED))
    assert tilt_of(fixed[0].candidate, sim) < np.radians(1)
    turned = sim.wrist(TILT)
    requested = next_best(result, candidates, Job(Policy.REQUESTED, [turned]))
    assert tilt_of(requested[0].candidate, sim) > np.radians(25)
    assert requested[0].after_mm < 0.5 * requested[0].before_mm
    assert requested[-1].after_mm > requested[0].after_mm


def test_advice_is_ranked_and_says_what_to_do_and_what_it_brings():
    sim, recording = session(looks=4, spins=3, wrists=tilted(Simulation(1)))
    look = Looking(Pose(sim.wrist(TILT), np.array([400.0, 50, 200])))
    candidates = [look, Spinning(2.5), *tilted_touches(calibrate_joint(recording), TILT)[:2]]
    advice = next_best(recording, candidates)
    assert [one.after_mm for one in advice] == sorted(one.after_mm for one in advice)
    assert all(one.after_mm <= one.before_mm for one in advice)
    assert isinstance(advice[0].candidate, Touching)
    sentences = " | ".join(one.sentence for one in advice)
    for words in ("touch P1 with the wrist as usual", "tilted by 30 degrees towards"):
        assert words in sentences
    assert "look with the flange at (400, 50, 200) mm" in sentences
    assert "turn the object to 143 degrees and take a picture: 95 % error" in sentences


def test_what_the_camera_cannot_see_brings_nothing():
    sim, recording = session(wrists=tilted(Simulation(1)))
    look = Looking(Pose(sim.wrist(TILT), np.array([400.0, 50, 200])))
    seen = next_best(recording, [look])[0]
    unseen = next_best(recording, [look], tag_a_in_view=lambda _: False)[0]
    assert unseen.after_mm == pytest.approx(unseen.before_mm)
    assert seen.after_mm < unseen.after_mm


def test_spins_count_where_the_turntable_is_poorly_known():
    sim, recording = session(spins=3, wrists=tilted(Simulation(1)))
    spin = next_best(recording, [Spinning(4.0)])[0]
    assert spin.after_mm < spin.before_mm
    still = Simulation(2).record(spins=0, wrists=tilted(sim))
    spin = next_best(still, [Spinning(4.0)], Job(angles_rad=[0.0]))[0]
    assert spin.after_mm == pytest.approx(spin.before_mm)


def random_wrists(rng, yaw_rad, count):
    """Tilted within 30 degrees, evenly over the disc, turned within +-yaw."""
    out = []
    for _ in range(count):
        side, tilt = rng.uniform(0, 2 * np.pi), TILT * np.sqrt(rng.uniform())
        tilted = exp_rotation([np.cos(side) * tilt, np.sin(side) * tilt, 0])
        yaw = exp_rotation([0, 0, rng.uniform(-yaw_rad, yaw_rad)])
        out.append(Simulation(0).wrist() @ tilted @ yaw)
    return out


def test_coached_touches_beat_random_ones_where_any_orientation_may_be_requested():
    rng, yaw = np.random.default_rng(5), np.radians(60)
    nominal = calibrate_joint(
        Simulation(1).record(spins=0, wrists=random_wrists(rng, yaw, 6)), arm=ArmModel()
    )
    works = random_wrists(rng, yaw, 4)
    candidates = tilted_touches(nominal, TILT, yaw, directions=4)
    job = Job(Policy.REQUESTED, works, angles_rad=(0.0, 2.0))
    plan = plan_touches(nominal, 6, candidates, job)
    coached = ([one.base_from_wrist for one in plan], [one.target for one in plan])
    found = {"coached": [], "random": []}
    for seed in range(8):
        for name in found:
            cell = Simulation(50 + seed, vision=COARSE)
            wrists, names = coached if name == "coached" else (random_wrists(rng, yaw, 6), None)
            recording = cell.record(spins=0, wrists=wrists, names=names)
            result = calibrate_joint(recording, arm=ArmModel())
            request = cell.request()
            expected = expected_by_joint(
                result, request.target, request.seen, Policy.REQUESTED, works[seed % 4]
            )
            tcp = np.trace(result.covariance[12:15, 12:15])
            found[name].append((tcp, np.trace(expected.position_covariance)))
    tcp, coordinate = np.sqrt(np.mean(found["coached"], 0) / np.mean(found["random"], 0))
    assert tcp <= 0.65
    assert coordinate <= 0.75
