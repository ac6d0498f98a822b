from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.robustness.conventions import free_session
from fakes.studies.robustness.degenerate import KINDS as DEGENERATE
from fakes.studies.robustness.mistakes import CONVENTIONS, OTHERS, with_poses
from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.acceptance import accept, confidence_of
from vgrd.calibration.checks import (
    bad_touches,
    cannot_tell,
    examine,
    missing_motion,
    missing_motions,
)
from vgrd.calibration.checks.interpretations import Turns, reread_candidates
from vgrd.calibration.observability.motion import turned_axes
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError
from vgrd.geometry import Pose, exp_rotation
from vgrd.geometry.covariance import radius95
from vgrd.geometry.rotation_formats import RotationFormat, rotation_from, rotation_to
from vgrd.model import Plan, Policy, Touch

ARM = ArmErrors(0.03, 0.1)
EULER = "kuka-abc-deg read as rpy-fixed-xyz-deg"
DEGREES = "rpy-fixed-xyz-deg read as rpy-fixed-xyz"


def codes(findings):
    return [finding.code for finding in findings]


def tilted(cell, count=8):
    return [cell.wrist(np.radians(25)) for _ in range(count)]


def session(seed=1, *, plan=Plan.UNIVERSAL, touches=8, looks=8, spins=6):
    cell = Simulation(seed, arm=ARM)
    wrists = tilted(cell, touches) if plan is Plan.UNIVERSAL else [WORK_ROTATION] * touches
    return cell, cell.record(plan=plan, wrists=wrists, looks=looks, spins=spins)


@pytest.mark.parametrize("plan", [Plan.UNIVERSAL, Plan.SPECIAL, Plan.JOINT])
def test_a_clean_session_of_every_plan_raises_no_finding(plan):
    for seed in range(4):
        _, recording = session(seed, plan=plan)
        assert examine(recording) == []
        assert missing_motion(recording) is None


@pytest.mark.parametrize(
    "name", [EULER, DEGREES, "rpy-fixed-xyz read as rotvec", "inverted poses", "mm read as metres"]
)
def test_a_mistaken_convention_is_named_alone(name):
    mistake = CONVENTIONS[name]
    _, recording = session(3)
    (found,) = examine(mistake.change(recording, np.random.default_rng(3)))
    assert found.code == mistake.code
    assert found.fatal
    assert any(words in found.message for words in mistake.words)


@pytest.mark.parametrize("kind", ["one wrist", "tilted"])
@pytest.mark.parametrize(
    "name", ["mirrored CAD points", "two targets swapped", "wrong order of targets"]
)
def test_a_mistake_in_the_cad_points_is_named(kind, name):
    mistake = CONVENTIONS[name]
    rng = np.random.default_rng(8)
    found = examine(mistake.change(free_session(kind, SeedSequence(8), rng), rng))
    assert codes(found) == [mistake.code]


@pytest.mark.parametrize("kind", ["one wrist", "tilted"])
def test_targets_in_the_wrong_order_are_named_in_whatever_order_they_were_touched(kind):
    rng = np.random.default_rng(8)
    mistaken = CONVENTIONS["wrong order of targets"]
    recording = mistaken.change(free_session(kind, SeedSequence(8), rng), rng)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(recording.touches))
        touches = tuple(recording.touches[i] for i in order)
        assert codes(examine(replace(recording, touches=touches))) == [mistaken.code]


def test_a_camera_on_the_flange_is_told_from_inverted_poses_by_tag_b():
    _, recording = session(4)
    rng = np.random.default_rng(0)
    in_hand = examine(CONVENTIONS["camera on the flange"].change(recording, rng))
    inverted = examine(CONVENTIONS["inverted poses"].change(recording, rng))
    assert codes(in_hand) == ["mount_wrong"]
    assert codes(inverted) == ["poses_inverted"]
    blind = CONVENTIONS["inverted poses"].change(replace(recording, touches=()), rng)
    (either,) = examine(blind)
    assert either.code == "poses_inverted_or_mount"


def test_one_bad_look_is_no_mistaken_convention():
    _, recording = session(5, looks=10)
    looks = list(recording.looks)
    off = Pose.from_rotvec((0.3, 0.2, 0.1), (20.0, 0.0, 0.0))
    looks[4] = replace(looks[4], base_from_wrist=looks[4].base_from_wrist @ off)
    assert examine(replace(recording, looks=tuple(looks))) == []


def test_poses_that_belong_to_other_pictures_contradict_each_other():
    _, recording = session(6, looks=10)
    poses = [seen.base_from_wrist for seen in recording.looks]
    touches = tuple(replace(touch, observation=None) for touch in recording.touches)
    looks = tuple(
        replace(seen, base_from_wrist=pose)
        for seen, pose in zip(recording.looks, np.roll(poses, 3), strict=True)
    )
    (found,) = examine(replace(recording, looks=looks, touches=touches))
    assert found.code == "poses_contradict"


def test_a_constant_active_tcp_cannot_be_told_and_that_is_said():
    _, recording = session(7)
    tcp = Pose.from_rotvec((0.2, 0.1, -0.4), (10.0, -30.0, 150.0))
    shifted = with_poses(recording, lambda pose: pose @ tcp)
    assert examine(shifted) == []
    assert codes(cannot_tell(recording.facts)) == ["flange_not_proven"]
    assert cannot_tell(replace(recording.facts, wrist_from_tcp=tcp)) == ()


@pytest.mark.parametrize("name", ["rpy-fixed-xyz", "zyz-deg", "rotvec-deg", "kuka-abc-deg"])
def test_all_numbers_of_a_rotation_are_numbers_of_that_rotation(name):
    fmt = RotationFormat(name)
    R = exp_rotation((2.0, -1.0, 0.7))
    same = reread_candidates(R[None], fmt, fmt)[0]
    assert len(same) == 2
    assert np.allclose(same, R, atol=1e-12)
    written = rotation_from(rotation_to(R, RotationFormat.ROTVEC), RotationFormat.RPY_FIXED_XYZ)
    back = reread_candidates(written[None], RotationFormat.RPY_FIXED_XYZ, RotationFormat.ROTVEC)
    assert min(np.abs(back[0] - R).max(axis=(1, 2))) < 1e-12


def test_turns_see_no_difference_between_frames():
    rng = np.random.default_rng(0)
    R = np.array([exp_rotation(rng.normal(size=3)) for _ in range(6)])
    left, right = exp_rotation(rng.normal(size=3)), exp_rotation(rng.normal(size=3))
    assert Turns(R).off_deg(left @ R @ right) < 1e-5
    assert Turns(R).off_deg(np.roll(R, 1, axis=0)[[1, 0, 2, 3, 4, 5]]) > 1


@pytest.mark.parametrize("kind", DEGENERATE)
def test_every_degenerate_session_names_its_motion(kind):
    make, code = DEGENERATE[kind]
    recording = make(Simulation(SeedSequence(11), arm=ARM))
    found = [one for one in missing_motions(recording) if one.code == code]
    assert found
    assert found[0].rank < found[0].unknowns
    assert code in codes(examine(recording))


def test_looks_at_the_poses_proposed_complete_the_hand_eye():
    for kind in ("parallel looks", "one axis, looks", "duplicated poses", "zero motion"):
        cell = Simulation(SeedSequence(12), arm=ARM)
        recording = DEGENERATE[kind][0](cell)
        for _ in range(4):
            missing = missing_motion(recording)
            if missing is None:
                break
            assert missing.code == "hand_eye_motion"
            seen = cell.observe(missing.base_from_wrist, 0.0)
            recording = replace(recording, looks=(*recording.looks, seen))
        assert missing_motion(recording) is None, kind


@pytest.mark.ordered("the robot stands where the last look was taken")
def test_a_look_proposed_after_turns_about_one_axis_keeps_tag_a_but_for_its_place_along_it():
    cell = Simulation(SeedSequence(13), arm=ARM)
    recording = DEGENERATE["one axis, looks"][0](cell)
    last = recording.looks[-1].base_from_wrist
    proposed = missing_motion(recording).base_from_wrist
    axis = turned_axes([seen.base_from_wrist.rotation for seen in recording.looks])[1]
    before, after = (pose @ cell.wrist_from_tag_a.translation for pose in (last, proposed))
    unknown = (proposed.rotation - last.rotation) @ last.rotation.T @ axis
    unknown /= np.linalg.norm(unknown)
    moved = after - before
    assert last.distance(proposed)[1] == pytest.approx(np.radians(25), abs=1e-9)
    assert np.linalg.norm(moved - unknown * (unknown @ moved)) < 2


@pytest.mark.ordered("the first touch is the one to repeat")
def test_a_tilt_proposed_where_the_tip_is_known_keeps_it_on_the_target():
    cell = Simulation(14)
    recording = cell.record(plan=Plan.UNIVERSAL, looks=8, spins=6, points=8)
    missing = missing_motion(recording)
    assert missing.code == "wrist_tilt"
    assert "and touch P1 again" in missing.sentence
    tip = missing.base_from_wrist @ cell.tcp_in_wrist
    assert np.linalg.norm(tip - cell.point("P1", 0.0)) < 1.5
    assert (
        np.linalg.norm((missing.base_from_wrist.rotation - WORK_ROTATION) @ cell.tcp_in_wrist) > 30
    )


def test_a_constant_wrist_lacks_a_tilt_only_where_the_job_turns_the_wrist():
    _, recording = session(15, plan=Plan.JOINT)
    assert missing_motion(recording) is None
    missing = missing_motion(recording, Policy.REQUESTED)
    assert missing.code == "wrist_tilt"
    assert missing.essential


def test_a_session_of_a_4_axis_robot_asks_for_a_tilt_without_refusing():
    cell = Simulation(16, arm=ARM, one_axis=True)
    recording = cell.record(plan=Plan.JOINT, wrists=tilted(cell), spins=6)
    (found,) = examine(recording)
    assert found.code == "hand_eye_motion"
    assert not found.fatal


def test_a_conventional_session_asks_for_turns_about_its_fixed_point():
    cell = Simulation(16)
    recording = cell.record(plan=Plan.CONVENTIONAL, looks=8, points=8)
    assert missing_motion(recording) is None
    none = replace(recording, points=())
    assert missing_motion(none).code == "fixed_point_motion"
    still = replace(recording, points=recording.points[:1] * 4)
    assert missing_motion(still).code == "fixed_point_motion"
    assert missing_motion(still).rank < 6


def test_a_session_just_begun_is_told_what_comes_next():
    _, recording = session(17)
    empty = replace(recording, looks=(), touches=(), spins=())
    begun = replace(empty, looks=recording.looks[:1], touches=recording.touches[:2])
    assert set(codes(examine(empty))) == {"hand_eye_motion", "few_touches", "object_turn"}
    assert {one.code for one in missing_motions(begun)} >= {"few_touches"}
    (few,) = [one for one in missing_motions(begun) if one.code == "few_touches"]
    assert few.target in recording.facts.object.targets


def test_the_size_of_tag_a_is_measured_by_the_robots_motion():
    _, recording = session(18, looks=12)
    stated = replace(recording.facts.tag_a, size_mm=25.0)
    factor = 25.0 / 24.6

    def farther(seen):
        at = seen.tag_a.camera_from_tag
        tag = replace(seen.tag_a, camera_from_tag=Pose(at.rotation, at.translation * factor))
        return replace(seen, tag_a=tag)

    facts = replace(recording.facts, tag_a=stated)
    looks = tuple(farther(seen) for seen in recording.looks)
    touches = tuple(replace(t, observation=farther(t.observation)) for t in recording.touches)
    (found,) = examine(replace(recording, facts=facts, looks=looks, touches=touches))
    assert found.code == "tag_size"
    assert "tag A measures 24.6" in found.message
    assert "the file says 25" in found.message


def flying(seed, late_s, count=40, step_s=0.1):
    """Looks taken on the move, pictures later than their poses."""

    def pose(t):
        turn = exp_rotation((0.3 * np.sin(t), 0.3 * np.sin(1.3 * t), 0.4 * np.sin(0.7 * t)))
        place = (350 + 80 * np.sin(t), 80 * np.sin(1.7 * t), 250 + 60 * np.cos(1.2 * t))
        return Pose(WORK_ROTATION @ turn, np.array(place))

    cell, recording = session(seed)
    looks = []
    for k in range(count):
        seen = cell.observe(pose(k * step_s + late_s), 0.0)
        looks.append(replace(seen, base_from_wrist=pose(k * step_s), stamp_s=k * step_s))
    return replace(recording, looks=tuple(looks))


def test_pictures_later_than_their_poses_are_told_with_the_delay():
    for late_s in (0.04, -0.06):
        (found,) = examine(flying(19, late_s))
        assert found.code == "time_offset"
        milliseconds = float(found.message.split("the robot ")[1].split(" ")[0])
        assert milliseconds == pytest.approx(1e3 * abs(late_s), abs=3)
        assert ("after" if late_s > 0 else "before") + " the pose" in found.message
    assert examine(flying(20, 0.0)) == []


def test_a_pose_that_was_not_read_again_is_told_from_one_recorded_twice():
    cell, recording = session(21)
    stale = OTHERS["pose not read again"].change(recording, np.random.default_rng(1))
    assert codes(examine(stale)) == ["pose_not_read_again"]
    first = recording.looks[0]
    again = replace(first, tag_a=cell.observe(first.base_from_wrist, 0.0).tag_a)
    twice = replace(recording, looks=(*recording.looks, replace(again, tag_a=first.tag_a)))
    assert codes(examine(twice)) == ["pose_repeated"]


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_an_object_that_moved_between_touches_is_named():
    cell, recording = session(22)
    pushed = cell.touch("P3", cell.wrist(0.3), angle_rad=0.1)
    (found,) = examine(replace(recording, touches=(*recording.touches, pushed)))
    assert found.code == "object_moved"
    assert "touch 9" in found.message


@pytest.mark.ordered("the number of a sample is part of what is expected")
@pytest.mark.parametrize("plan", [Plan.UNIVERSAL, Plan.SPECIAL])
def test_a_touch_that_is_5_mm_off_is_the_only_one_named(plan):
    _, recording = session(23, plan=plan)
    assert bad_touches(recording) == ()
    touches = list(recording.touches)
    pose = touches[2].base_from_wrist
    moved = Pose(pose.rotation, pose.translation + np.array([3.0, 4.0, 0.0]))
    touches[2] = replace(touches[2], base_from_wrist=moved)
    (found,) = bad_touches(replace(recording, touches=tuple(touches)))
    assert found.code == "touch_outlier"
    assert found.fatal
    assert found.message.startswith("touch 3 (P3)")


@pytest.mark.ordered("the number of a sample is part of what is expected")
@pytest.mark.parametrize("plan", [Plan.UNIVERSAL, Plan.SPECIAL])
def test_two_bad_touches_are_both_named_in_the_verdict_and_undoing_them_is_enough(plan):
    _, recording = session(23, plan=plan)
    touches = list(recording.touches)
    for i, offset in ((1, (4.0, -3.0, 2.0)), (6, (-4.0, 4.0, 1.0))):
        pose = touches[i].base_from_wrist
        moved = Pose(pose.rotation, pose.translation + np.array(offset))
        touches[i] = replace(touches[i], base_from_wrist=moved)
    verdict = calibrate_system(replace(recording, touches=tuple(touches))).verdict
    named = [one.message[:12] for one in verdict.findings if one.code == "touch_outlier"]
    assert named == ["touch 2 (P2)", "touch 7 (P1)"]
    assert not verdict.ok
    left = tuple(touch for i, touch in enumerate(touches) if i not in (1, 6))
    assert bad_touches(replace(recording, touches=left)) == ()


def test_of_four_touches_that_contradict_each_other_the_worst_is_named():
    _, recording = session(23, plan=Plan.SPECIAL, touches=4)
    pose = recording.touches[0].base_from_wrist
    moved = Pose(pose.rotation, pose.translation + np.array([3.0, 4.0, 0.0]))
    bad = replace(recording.touches[0], base_from_wrist=moved)
    found = bad_touches(replace(recording, touches=(bad, *recording.touches[1:])))
    assert len(found) == 1
    assert found[0].fatal


def test_a_touch_of_an_unknown_target_is_refused_with_the_known_ones():
    _, recording = session(24)
    stray = replace(recording.touches[0], target="P9")
    with pytest.raises(InputError, match="no target 'P9'"):
        examine(replace(recording, touches=(*recording.touches, stray)))
    assert isinstance(stray, Touch)


def test_the_order_of_the_samples_changes_no_finding():
    _, recording = session(25)
    wrong = CONVENTIONS[EULER].change(recording, np.random.default_rng(0))
    turned = replace(wrong, looks=wrong.looks[::-1], touches=wrong.touches[::-1])
    assert codes(examine(wrong)) == codes(examine(turned))


def test_acceptance_tells_the_confidence_that_sampling_finds():
    rng = np.random.default_rng(0)
    C = np.diag([0.01, 0.02, 0.05])
    misses = np.linalg.norm(rng.multivariate_normal(np.zeros(3), C, 100_000), axis=1)
    for tolerance in (0.2, 0.3, 0.5, 0.8):
        sure = confidence_of(radius95(C), tolerance, C)
        assert sure == pytest.approx(np.mean(misses <= tolerance), abs=0.02)
    assert confidence_of(0.3, 0.3) == pytest.approx(0.95)


def test_acceptance_says_how_sure_it_is_and_never_that_something_converged():
    good, bad = accept(0.25, 0.3), accept(0.5, 0.3)
    assert (good.code, good.fatal) == ("meets_tolerance", False)
    assert (bad.code, bad.fatal) == ("misses_tolerance", True)
    assert good.message.startswith("meets 0.3 mm with 99 % confidence")
    assert "does not meet 0.3 mm" in bad.message
    assert "converged" not in good.message + bad.message
    assert "more than 99.9 %" in accept(0.1, 1.0).message
    assert accept(float("inf"), 1.0).fatal
    with pytest.raises(InputError, match="above zero"):
        accept(0.1, 0.0)
