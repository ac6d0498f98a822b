from dataclasses import replace

import numpy as np
import pytest

from fakes.world.noise import COARSE
from fakes.world.simulation import Simulation
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.planning.next_sample import (
    Job,
    Looking,
    Reach,
    Spinning,
    Touching,
    next_best,
    plan_samples,
    plan_touches,
    rank_samples,
)
from vgrd.calibration.planning.predicted_error import PredictedError
from vgrd.calibration.planning.reach import (
    Box,
    camera_sees_tag_a,
    flange_of,
    samples_within,
    touch_pose,
    touches_within,
)
from vgrd.errors import InputError
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import ArmModel, Motion, Policy

TILT = np.radians(30)


def session(seed=1, looks=4, spins=4, **options):
    sim = Simulation(seed, vision=COARSE)
    return sim, sim.record(looks=looks, spins=spins, **options)


def tilted(sim, fixed=3, tilted=3):
    return [sim.wrist()] * fixed + [sim.wrist(TILT) for _ in range(tilted)]


def tilted_only(result, targets=None):
    """Touches upright and fully tilted."""
    return touches_within(result, Reach(TILT, 0.0), targets)


def tilt_of(touching, sim):
    return np.arccos(np.clip(touching.base_from_wrist[:, 2] @ sim.wrist()[:, 2], -1, 1))


def test_a_predicted_error_is_the_one_after_the_sample_was_taken():
    sim, recording = session(wrists=tilted(Simulation(1)))
    result = calibrate_joint(recording, arm=ArmModel(0.02), find_noise=False)
    job = Job(targets=["P2"], angles_rad=[0.7])
    candidates = tilted_only(result, ["P4"])[:3]
    for advice in rank_samples(result, candidates, job):
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
        after = calibrate_joint(more, arm=ArmModel(0.02), find_noise=False)
        again = rank_samples(after, candidates[:1], job)[0]
        assert advice.after_mm == pytest.approx(again.before_mm, rel=0.03)
        assert advice.after_mm < advice.before_mm


def test_a_fixed_wrist_wants_straight_touches_and_a_requested_one_wants_tilted_ones():
    sim, recording = session()
    result = calibrate_joint(recording)
    candidates = tilted_only(result)
    fixed = rank_samples(result, candidates, Job(Policy.FIXED))
    assert tilt_of(fixed[0].candidate, sim) < np.radians(1)
    turned = sim.wrist(TILT)
    requested = rank_samples(result, candidates, Job(Policy.REQUESTED, [turned]))
    assert tilt_of(requested[0].candidate, sim) > np.radians(25)
    assert requested[0].after_mm < 0.5 * requested[0].before_mm
    assert requested[-1].after_mm > requested[0].after_mm


def test_advice_is_ranked_and_says_what_to_do_and_what_it_brings():
    sim, recording = session(looks=4, spins=3, wrists=tilted(Simulation(1)))
    look = Looking(Pose(sim.wrist(TILT), np.array([400.0, 50, 200])))
    candidates = [look, Spinning(2.5), *tilted_only(calibrate_joint(recording))[:17:16]]
    advice = rank_samples(recording, candidates)
    assert [one.after_mm for one in advice] == sorted(one.after_mm for one in advice)
    assert all(one.after_mm <= one.before_mm for one in advice)
    assert isinstance(advice[0].candidate, Touching)
    sentences = " | ".join(one.sentence for one in advice)
    for words in ("touch P1 with the wrist as usual", "tilted by 30 degrees towards"):
        assert words in sentences
    assert "look with the flange at (400, 50, 200) mm, with the tip tilted" in sentences
    assert "turn the object to 143 degrees and take a picture: 95 % error" in sentences


def test_what_the_camera_cannot_see_brings_nothing():
    sim, recording = session(wrists=tilted(Simulation(1)))
    look = Looking(Pose(sim.wrist(TILT), np.array([400.0, 50, 200])))
    seen = rank_samples(recording, [look])[0]
    unseen = rank_samples(recording, [look], tag_a_in_view=lambda _: False)[0]
    assert unseen.after_mm == pytest.approx(unseen.before_mm)
    assert seen.after_mm < unseen.after_mm


def test_spins_count_where_the_turntable_is_poorly_known():
    sim, recording = session(spins=3, wrists=tilted(Simulation(1)))
    spin = rank_samples(recording, [Spinning(4.0)])[0]
    assert spin.after_mm < spin.before_mm
    still = Simulation(2).record(looks=3, spins=0, wrists=tilted(sim))
    spin = rank_samples(still, [Spinning(4.0)], Job(angles_rad=[0.0]))[0]
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
    job = Job(Policy.REQUESTED, works, angles_rad=(0.0, 2.0))
    plan = plan_touches(nominal, 6, job, Reach(TILT, yaw))
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


def reach_of_all_kinds():
    """Tilt, a box, and joints that forbid a side."""
    box = Box(np.array([200.0, -150, 0]), np.array([500.0, 150, 400]))
    return Reach(
        np.radians(20), np.radians(40), None, [box], lambda pose: pose.rotation[0, 2] < 0.1
    )


def stand_of(result, candidate):
    """Where the flange stands, the object turned by as much as a touch says."""
    if isinstance(candidate, Touching):
        return touch_pose(result, candidate)
    return flange_of(result, candidate)


def test_nothing_is_proposed_beyond_tilt_boxes_or_joints():
    sim, recording = session(wrists=tilted(Simulation(1)))
    result = calibrate_joint(recording)
    reach = reach_of_all_kinds()
    bound = samples_within(result, reach)
    assert {type(one) for one in bound} == {Touching, Looking, Spinning}
    unbound = samples_within(result, replace(reach, within_joints=None))
    forbidden = [one for one in unbound if not isinstance(one, Spinning)]
    forbidden = [one for one in forbidden if stand_of(result, one).rotation[0, 2] >= 0.1]
    assert forbidden
    assert len(bound) == len(unbound) - len(forbidden)
    for flange in (stand_of(result, one) for one in bound if not isinstance(one, Spinning)):
        tilt = np.arccos(np.clip(flange.rotation[:, 2] @ sim.wrist()[:, 2], -1, 1))
        assert tilt <= np.radians(20) + 1e-6
        assert (reach.boxes[0].lower <= flange.translation).all()
        assert (flange.translation <= reach.boxes[0].upper).all()
        assert flange.rotation[0, 2] < 0.1


def test_the_nominal_axis_may_be_given_and_tilts_start_from_it():
    _, recording = session(wrists=tilted(Simulation(1)))
    result = calibrate_joint(recording)
    leaning = exp_rotation((0.4, 0, 0)) @ np.array([0.0, 0, -1])
    touches = touches_within(result, Reach(np.radians(10), 0.0, leaning))
    tilts = [np.degrees(np.arccos(min(t.base_from_wrist[:, 2] @ leaning, 1))) for t in touches]
    np.testing.assert_allclose(np.unique(np.round(tilts, 4)), [0, 5, 10], atol=1e-3)


def test_an_arm_of_four_axes_is_never_asked_to_tilt():
    sim = Simulation(4, one_axis=True)
    recording = sim.record(looks=3, spins=3, wrists=[sim.wrist(1.5) for _ in range(5)])
    reach = Reach.of(recording)
    assert reach.max_tilt_rad == 0
    result = calibrate_joint(recording)
    for advice in next_best(result, reach=reach):
        if not isinstance(advice.candidate, Spinning):
            stand = stand_of(result, advice.candidate)
            np.testing.assert_allclose(stand.rotation[:, 2], [0, 0, -1], atol=1e-6)
    six_axes = Simulation(4).record(wrists=tilted(Simulation(1)))
    assert Reach.of(six_axes).max_tilt_rad > 0


def test_the_tcp_of_four_axes_is_named_unknown_and_irrelevant_until_a_tilt_is_asked_for():
    sim = Simulation(4, one_axis=True)
    recording = sim.record(looks=4, spins=4, wrists=[sim.wrist(1.5) for _ in range(6)])
    result = calibrate_joint(recording)
    for job in (Job(), Job(Policy.FOLLOW), Job(Policy.REQUESTED, [sim.wrist(2.0)])):
        open_directions = PredictedError(result, job).undetermined()
        assert [one.matters for one in open_directions] == [False, False]
        assert "the TCP along (0.00, 0.00, 1.00) of the flange" in [
            o.what for o in open_directions
        ]
    tilted_work = Simulation(1).wrist(0.4)
    asked = PredictedError(result, Job(Policy.REQUESTED, [tilted_work])).undetermined()
    assert [one.matters for one in asked if "TCP" in one.what] == [True]


def test_advice_is_the_same_every_time():
    _, recording = session(looks=3, spins=3, wrists=tilted(Simulation(1)))
    first, second = (next_best(recording, reach=reach_of_all_kinds()) for _ in range(2))
    assert [one.sentence for one in first] == [one.sentence for one in second]
    assert [one.after_mm for one in first] == [one.after_mm for one in second]


def test_where_nothing_is_within_reach_that_is_said():
    _, recording = session()
    with pytest.raises(InputError, match="no sample is within reach"):
        next_best(recording, reach=Reach(within_joints=lambda _: False, turns_rad=()))
    with pytest.raises(InputError, match="empty"):
        Box(np.ones(3), np.zeros(3))
    with pytest.raises(InputError, match="180 degrees"):
        Reach(max_tilt_rad=-0.1)


def test_a_free_object_is_never_spun():
    _, recording = session(wrists=tilted(Simulation(1)))
    facts = replace(recording.facts, object=replace(recording.facts.object, motion=Motion.FREE))
    result = calibrate_joint(replace(recording, facts=facts))
    assert not [one for one in samples_within(result, Reach()) if isinstance(one, Spinning)]


def test_the_camera_sees_tag_a_within_its_picture_only():
    _, recording = session(wrists=tilted(Simulation(1)))
    result = calibrate_joint(recording)
    sees = camera_sees_tag_a(result)
    tag = result.data.looks.tags.poses()[0]
    at = np.array([0.0, 0.0, 600.0])
    assert sees(Pose(tag.rotation, at))
    assert not sees(Pose(tag.rotation, np.array([400.0, 0, 600])))
    assert not sees(Pose(tag.rotation, -at))
    assert not sees(Pose(tag.rotation @ exp_rotation((np.pi, 0, 0)), at))
    assert not sees(Pose(tag.rotation @ exp_rotation((np.radians(80), 0, 0)), at))


def test_a_session_planned_as_a_whole_has_touches_and_spins():
    rng = np.random.default_rng(5)
    recording = Simulation(1).record(looks=2, spins=3, wrists=random_wrists(rng, 1.0, 6))
    nominal = calibrate_joint(recording, arm=ArmModel())
    job = Job(Policy.REQUESTED, random_wrists(rng, 1.0, 2), angles_rad=(0.0, 2.0))
    plan = plan_samples(nominal, 9, job, Reach(TILT, 1.0))
    kinds = [type(one) for one in plan]
    assert kinds.count(Touching) >= 6
    assert kinds.count(Spinning) >= 1
