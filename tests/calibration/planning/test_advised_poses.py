"""An operator may drive where advice says: no pose from touches that lie, nor where the arm never was."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import Simulation
from vgrd.calibration.planning.advice import SessionAdvice, advise_session
from vgrd.calibration.planning.next_sample import Spinning, Touching
from vgrd.calibration.planning.reach import Reach
from vgrd.geometry import Pose, exp_rotation
from vgrd.model import Policy, Recording

TILT = np.radians(20)
NEAR_MM = 5.0  # what is promised of a named place
STAGES = {
    "four varied": (3, 0, "vvvv"),
    "four upright": (3, 0, "uuuu"),
    "five mixed": (3, 1, "uuvvv"),
    "six varied": (4, 3, "vvvvvv"),
    "six upright": (4, 3, "uuuuuu"),
    "six mixed": (4, 3, "uuuvvv"),
    "no looks": (0, 0, "uuuvvv"),
    "nine": (6, 5, "uuuuuuvvv"),
}
Names = Sequence[str] | None


def session(
    seed: int, stage: str, names: Names = None, sim: Simulation | None = None
) -> tuple[Simulation, Recording]:
    sim = sim or Simulation(seed, vision=COARSE)
    looks, spins, wrists = STAGES[stage]
    turned = [sim.wrist(TILT if one == "v" else 0.0) for one in wrists]
    return sim, sim.record(looks=looks, spins=spins, wrists=turned, names=names)


def called(recording: Recording, names: Sequence[str]) -> Recording:
    """The same touches under other names."""
    touches = zip(recording.touches, names, strict=True)
    return replace(recording, touches=tuple(replace(t, target=name) for t, name in touches))


def swapped(recording: Recording, a: str, b: str) -> Recording:
    return called(recording, [{a: b, b: a}.get(t.target, t.target) for t in recording.touches])


def pairs_of(recording: Recording) -> list[tuple[str, str]]:
    return list(combinations(sorted({touch.target for touch in recording.touches}), 2))


def pose_of(advice: SessionAdvice) -> Pose | None:
    return None if advice.best is None else advice.best.base_from_wrist


def turns_object(advice):
    """Whether the next sample asks for a turn of the object, which has no pose of the arm."""
    one = advice.best.candidate
    return isinstance(one, Spinning) or (isinstance(one, Touching) and one.turn_rad != 0)


def names_no_pose(advice: SessionAdvice) -> bool:
    """Neither as numbers nor in words, and a reason in words for it."""
    told = advice.to_json()["next"]
    if told is None:
        return advice.trouble != ""
    if advice.best is None:  # the plan's next sample, in words alone
        return told["flange_mm"] is None and advice.trouble != ""
    if isinstance(advice.best.candidate, Spinning):
        return True
    return (
        told["flange_mm"] is None
        and told["no_pose"] != ""
        and not re.search(r"mm,", told["words"])
    )


def test_four_touches_with_two_targets_exchanged_get_words_and_no_pose():
    _, recording = session(1, "four varied")
    advice = advise_session(swapped(recording, "P1", "P2"))
    told = advice.to_json()
    assert told["next"] is None
    assert told["predicted_u95_mm"] == {}
    assert "the targets that the touches name" in told["trouble"]


@pytest.mark.ordered("the number of a sample is part of what is expected")
@pytest.mark.parametrize("stage", ["six varied", "six upright", "six mixed"])
def test_six_touches_with_two_targets_exchanged_are_told_to_mend_that_first(stage):
    _, recording = session(1, stage)
    advice = advise_session(swapped(recording, "P1", "P2"))
    assert advice.best is None
    assert "targets_swapped" in [one.code for one in advice.findings]
    assert advice.trouble.startswith("before any other sample: the targets of touch '1 (P2)'")


def test_what_is_missing_is_told_where_the_samples_allow_no_estimate():
    _, recording = session(1, "six mixed")
    advice = advise_session(replace(recording, touches=()))
    assert advice.best is None
    assert "few_touches" in [one.code for one in advice.findings]


def test_too_few_touches_get_words_and_no_pose():
    _, recording = session(1, "six mixed")
    for count in (1, 2, 3):
        assert names_no_pose(advise_session(replace(recording, touches=recording.touches[:count])))


@pytest.mark.parametrize("stage", ["four varied", "four upright", "six mixed", "six upright"])
def test_no_exchange_of_two_targets_ever_gets_a_pose(stage):
    for seed in (2, 3, 4):
        _, recording = session(seed, stage)
        for a, b in pairs_of(recording)[seed % 3 :: 3]:
            advice = advise_session(swapped(recording, a, b))
            assert names_no_pose(advice), (seed, a, b, advice.best.sentence)


@pytest.mark.parametrize("stage", ["four varied", "four upright", "six mixed"])
def test_no_touch_of_another_target_than_it_says_ever_gets_a_pose(stage):
    _, recording = session(4, stage)
    names = [touch.target for touch in recording.touches]
    for i, name in enumerate(names):
        wrong = f"P{(int(name[1]) + i % 4) % 6 + 1}"
        advice = advise_session(called(recording, [*names[:i], wrong, *names[i + 1 :]]))
        assert names_no_pose(advice), (name, wrong, advice.best.sentence)


@pytest.mark.parametrize("wrists", ["upright", "varied"])
def test_touches_that_would_not_show_an_exchange_get_words_only(wrists):
    """P1 and P3 are mirror images about the line of P2 and P5: exchanged, all four fit as well."""
    sim = Simulation(6, vision=COARSE)
    turned = [sim.wrist(TILT * (wrists == "varied")) for _ in range(4)]
    recording = sim.record(looks=3, spins=3, wrists=turned, names=["P1", "P2", "P3", "P5"])
    for taught in (recording, swapped(recording, "P1", "P3")):
        advice = advise_session(taught)
        assert names_no_pose(advice)
        if wrists == "varied":
            assert "P1 and P3 were exchanged" in advice.no_pose


@pytest.mark.ordered("the number of a sample is part of what is expected")
def test_a_touch_that_the_others_contradict_keeps_the_words_and_takes_the_pose():
    _, recording = session(1, "nine")
    touches = list(recording.touches)
    pose = touches[2].base_from_wrist
    off = Pose(pose.rotation, pose.translation + np.array([3.0, 0, 0]))
    touches[2] = replace(touches[2], base_from_wrist=off)
    advice = advise_session(replace(recording, touches=tuple(touches)))
    assert advice.best is not None
    assert len(advice.predicted_mm) == 6
    assert "touch 3" in advice.no_pose
    assert names_no_pose(advice)


@pytest.mark.parametrize("stage", list(STAGES))
def test_a_correct_session_keeps_its_proposal_and_a_named_pose_leads_to_its_target(stage):
    for seed in (11, 12, 13):
        arm = ArmErrors(0.03, 0.1) if seed == 13 else ArmErrors()
        sim, recording = session(seed, stage, sim=Simulation(seed, vision=COARSE, arm=arm))
        advice = advise_session(recording)
        assert not [one for one in advice.findings if one.fatal]
        assert advice.best.after_mm <= advice.best.before_mm
        pose = pose_of(advice)
        if pose is None:
            assert turns_object(advice) or names_no_pose(advice)
            continue
        stood = [t.base_from_wrist for t in recording.touches]
        if isinstance(advice.best.candidate, Touching):
            target = sim.point(advice.best.candidate.target, 0.0)
            assert np.linalg.norm(pose @ sim.tcp_in_wrist - target) <= NEAR_MM
        else:
            stood += [look.base_from_wrist for look in recording.looks]
        places = np.array([one.translation for one in stood])
        assert (pose.translation >= places.min(axis=0) - 100).all()
        assert (pose.translation <= places.max(axis=0) + 100).all()
        tilts = [np.arccos(min(one.rotation[:, 2] @ pose.rotation[:, 2], 1)) for one in stood]
        assert min(tilts) <= np.radians(30) + 1e-6


@pytest.mark.parametrize("stage", ["six varied", "six upright", "six mixed", "nine"])
def test_a_correct_session_of_enough_touches_is_given_a_pose_or_a_turn_of_the_object(stage):
    for seed in (21, 22):
        _, recording = session(seed, stage)
        advice = advise_session(recording)
        assert advice.no_pose == ""
        assert pose_of(advice) is not None or turns_object(advice)


def test_a_tilted_touch_is_words_as_long_as_the_tcp_is_open():
    """Its flange pose rests on a TCP that upright touches leave open by any length."""
    _, recording = session(1, "six upright")
    advice = advise_session(recording, Policy.REQUESTED, Reach())
    assert "tilted by" in advice.best.sentence
    assert names_no_pose(advice)


def test_a_work_orientation_far_from_what_was_reached_is_words():
    _, recording = session(1, "nine")
    far = recording.touches[0].base_from_wrist.rotation @ exp_rotation((1.2, 0, 0))
    targets = {
        name: replace(target, base_from_work=far)
        for name, target in recording.facts.object.targets.items()
    }
    spec = replace(recording.facts.object, targets=targets)
    facts = replace(recording.facts, object=spec)
    advice = advise_session(replace(recording, facts=facts))
    assert isinstance(advice.best.candidate, Touching)
    assert names_no_pose(advice)
