"""Advice comes with every sample, from a process that no sample waits for, however little is recorded."""

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.testing import ManualClock
from fakes.world.layout import Layout
from fakes.world.simulation import Simulation
from fakes.world.world import CellNoise, World
from vgrd.calibration.planning.advice import advise_session
from vgrd.calibration.planning.reach import Reach
from vgrd.cell.recording.recorder import Recorder
from vgrd.cell.recording.teaching import Teaching
from vgrd.config.cell_file import TouchSection
from vgrd.devices import FlangeReading
from vgrd.devices.stillness import RestLimits
from vgrd.errors import CalibrationError, ControlError, InputError
from vgrd.geometry import Pose
from vgrd.model import Observation, Policy, Recording, Stability
from vgrd.solving import advisor as advising
from vgrd.solving.advisor import Advisor, answer_line
from vgrd.store.sessions import SampleKind

LONG_S = 3600.0  # longer than the busiest machine takes


@pytest.fixture(scope="module")
def rehearsed(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    world = World(Layout(), 5, CellNoise())
    facts = facts_of(world, tmp_path_factory.mktemp("rehearsed"))
    return Rehearsal(world, facts).teach(looks=4, spins=3, tilted=3, points=0)


def first(recording: Recording, looks: int, spins: int, touches: int) -> Recording:
    return replace(
        recording,
        looks=recording.looks[:looks],
        spins=recording.spins[:spins],
        touches=recording.touches[:touches],
    )


@pytest.mark.parametrize(
    ("counts", "policy"),
    [
        ((0, 0, 0), Policy.FIXED),
        ((3, 0, 0), Policy.FIXED),
        ((0, 1, 1), Policy.FIXED),
        ((4, 1, 1), Policy.REQUESTED),
        ((0, 2, 4), Policy.FOLLOW),
    ],
)
def test_a_half_recorded_session_is_told_about_and_never_an_error(rehearsed, counts, policy):
    advice = advise_session(first(rehearsed, *counts), policy)
    told = advice.to_json()
    assert told["trouble"] or told["predicted_u95_mm"]
    if counts[2] == 0:
        assert "touch" in told["trouble"]
        assert told["next"]["words"].startswith(f"look {counts[0] + 1} of 8: ")


def test_a_whole_session_has_a_predicted_error_and_a_next_sample_as_a_pose(rehearsed):
    told = advise_session(rehearsed, Policy.FIXED).to_json()
    assert told["trouble"] == ""
    assert told["findings"] == []
    assert sorted(told["predicted_u95_mm"]) == [f"P{k}" for k in range(1, 7)]
    assert all(0 < value < 1.5 for value in told["predicted_u95_mm"].values())
    best = told["next"]
    assert best["u95_after_mm"] < best["u95_before_mm"]
    assert best["words"].split()[0] in ("touch", "look", "turn")
    if best["flange_mm"] is not None:
        assert len(best["flange_mm"]) == len(best["rotvec_deg"]) == 3


def test_a_wrist_that_never_tilted_is_told_to_tilt_when_orientations_are_requested(rehearsed):
    upright = replace(rehearsed, touches=rehearsed.touches[:6])
    fixed = advise_session(upright, Policy.FIXED)
    assert fixed.trouble == ""
    assert any("TCP" in one.what and not one.matters for one in fixed.undetermined)
    requested = advise_session(upright, Policy.REQUESTED, Reach())
    assert "the TCP along" in requested.trouble
    assert requested.predicted_mm == {}
    assert "tilted by" in requested.best.sentence


def test_a_bad_touch_is_a_finding():
    sim = Simulation(1)
    recording = sim.record(wrists=[sim.wrist()] * 6 + [sim.wrist(0.4) for _ in range(3)])
    touches = list(recording.touches)
    pose = touches[2].base_from_wrist
    off = Pose(pose.rotation, pose.translation + np.array([3.0, 0, 0]))
    touches[2] = replace(touches[2], base_from_wrist=off)
    findings = advise_session(replace(recording, touches=tuple(touches))).findings
    assert any("touch 3" in finding.message for finding in findings)


def test_spins_count_only_once_they_tell_the_axis(rehearsed):
    early = advise_session(first(rehearsed, 4, 1, 9))
    assert "spins_unusable" in [finding.code for finding in early.findings]
    assert len(early.predicted_mm) == 6
    assert advise_session(rehearsed).findings == ()


class Bench:
    """What a teaching session needs of the cell; what is seen is set by hand."""

    def __init__(self, folder: Path, recording: Recording) -> None:
        self.clock = ManualClock()
        self.now: Observation | None = None
        self.robot, self.limits = self, RestLimits()
        self.advisor = Advisor(Policy.FIXED)
        self.recorder = Recorder(folder, self.clock)
        self.teaching = Teaching(
            self,
            self.recorder,
            recording.facts,
            TouchSection(),
            self.advisor,
        )

    def newest(self, within_s: float) -> FlangeReading:
        del within_s
        return FlangeReading(Pose.identity(), None, 1000.0, 1000.0)

    async def rest(self) -> Pose:
        return self.now.base_from_wrist

    async def fresh(self, timeout_s: float) -> "Bench":
        del timeout_s
        return self

    @property
    def tag_a(self):
        return self.now.tag_a

    @property
    def tag_b(self):
        return self.now.tag_b

    def observation(self) -> Observation:
        return self.now

    async def teach(self, recording: Recording) -> list[dict[str, object]]:
        replies = []
        for look in recording.looks:
            self.now = look
            replies.append(await self.teaching.look())
        for spin in recording.spins:
            self.now = spin
            replies.append(await self.teaching.spin())
        for touch in recording.touches:
            self.now = touch.observation
            replies.append(await self.teaching.touch(touch.target, SampleKind.TOUCH))
        return replies


@pytest.fixture
def bench(tmp_path: Path, rehearsed: Recording) -> Bench:
    return Bench(tmp_path, rehearsed)


def test_every_reply_carries_advice_and_the_whole_of_it_can_be_asked_for(
    bench, rehearsed, monkeypatch
):
    monkeypatch.setattr(advising, "FULL_S", LONG_S)

    async def taught() -> tuple[list[dict[str, object]], dict[str, object], dict[str, object]]:
        with pytest.raises(ControlError, match="no session was recorded yet"):
            await bench.teaching.advise(LONG_S)
        running = asyncio.create_task(bench.advisor.run())
        await bench.teaching.start("joint", "one")
        replies = await bench.teach(rehearsed)
        replies.append(await bench.teaching.undo())
        told = await bench.teaching.advise(LONG_S, policy="follow", tilt_deg=10.0)
        await bench.advisor._process.communicate(b"")
        again = await bench.teaching.advise(LONG_S)
        await bench.teaching.stop()
        running.cancel()
        return replies, told, again

    replies, told, again = asyncio.run(taught())
    assert len(replies) == 17
    assert all("pending" in r["advice"] or "next" in r["advice"] for r in replies)
    assert told["policy"] == "follow"
    assert len(told["predicted_u95_mm"]) == 6
    assert again["policy"] == "fixed"
    assert bench.advisor._process is None


def test_a_movable_camera_is_taught_by_plan_joint_and_wants_no_looks(tmp_path, rehearsed):
    facts = replace(rehearsed.facts, camera_stability=Stability.MOVABLE)
    bench = Bench(tmp_path, replace(rehearsed, facts=facts))
    bench.teaching.advisor = None

    async def taught() -> dict[str, object]:
        with pytest.raises(InputError, match="teach with plan joint"):
            await bench.teaching.start("special", "one")
        await bench.teaching.start("joint", "one")
        (reply,) = await bench.teach(
            replace(rehearsed, looks=(), spins=rehearsed.spins[:1], touches=())
        )
        await bench.teaching.stop()
        return reply

    assert asyncio.run(taught())["missing"] == {"spin": 3, "touch": 8}


def test_samples_do_not_wait_for_an_adviser_that_hangs(bench, rehearsed, monkeypatch):
    async def hanging(request: object) -> None:
        await asyncio.sleep(3600)

    monkeypatch.setattr(bench.advisor, "_exchanged", hanging)
    monkeypatch.setattr(advising, "BRIEF_S", 0.01)

    async def taught() -> list[dict[str, object]]:
        running = asyncio.create_task(bench.advisor.run())
        await bench.teaching.start("joint", "two")
        replies = await bench.teach(first(rehearsed, 2, 0, 1))
        asked = asyncio.create_task(bench.teaching.advise(LONG_S))
        await asyncio.sleep(0.05)
        await bench.teaching.stop()
        with pytest.raises(CalibrationError, match="ask again"):
            await asked
        running.cancel()
        return replies

    replies = asyncio.run(taught())
    assert all("pending" in reply["advice"] for reply in replies)
    assert replies[-1]["have"] == {"look": 2, "touch": 1}


def test_what_needs_no_computing_is_told_while_the_rest_is_computed_once(
    bench, rehearsed, monkeypatch
):
    """An operator who obeys the reply takes looks first, each turned otherwise."""
    asked: list[object] = []

    async def hanging(request: object) -> None:
        asked.append(request)
        await asyncio.sleep(3600)

    monkeypatch.setattr(bench.advisor, "_exchanged", hanging)
    monkeypatch.setattr(advising, "BRIEF_S", 0.01)

    async def taught() -> tuple[list[dict[str, object]], list[dict[str, object]]]:
        running = asyncio.create_task(bench.advisor.run())
        await bench.teaching.start("joint", "two")
        replies = await bench.teach(first(rehearsed, 2, 0, 0))
        await asyncio.sleep(0.01)
        told = [await bench.teaching.advise(0.01) for _ in range(2)]
        await bench.teaching.stop()
        running.cancel()
        return replies, told

    replies, told = asyncio.run(taught())
    words = [reply["advice"]["next"]["words"] for reply in replies]
    assert words[0].startswith("look 2 of 8: turn the wrist by ")
    assert words[1].startswith("look 3 of 8: turn the wrist by ")
    assert all("pending" in one and one["next"]["words"] == words[1] for one in told)
    assert len(asked) <= len(replies)  # the same state of the session is asked about once


def test_a_fault_of_ours_while_advising_is_raised_where_it_is_awaited(
    bench, rehearsed, monkeypatch
):
    async def faulty(request: object) -> None:
        raise LookupError("a bug")

    monkeypatch.setattr(bench.advisor, "_exchanged", faulty)

    async def taught() -> None:
        running = asyncio.create_task(bench.advisor.run())
        await bench.teaching.start("joint", "three")
        with pytest.raises(LookupError):
            await bench.teach(first(rehearsed, 1, 0, 0))
        with pytest.raises(ExceptionGroup) as told:
            await running
        assert told.group_contains(LookupError, match="a bug")
        await bench.recorder.stop()
        await bench.advisor.close()

    asyncio.run(taught())


def test_a_fault_of_ours_while_writing_is_told_and_samples_are_taken(
    bench, rehearsed, monkeypatch, tmp_path
):
    def faulty(writer: object, readings: object) -> None:
        raise LookupError("a bug")

    monkeypatch.setattr(bench.recorder, "_write_readings", faulty)

    async def taught() -> dict[str, object]:
        running = asyncio.create_task(bench.advisor.run())
        await bench.teaching.start("joint", "four")
        bench.recorder.on_readings([bench.newest(1.0)])
        (reply,) = await bench.teach(first(rehearsed, 1, 0, 0))
        told = bench.teaching.status()
        bench.recorder._thinning.add([bench.newest(1.0)])
        with pytest.raises(LookupError):  # of the last readings; the control socket answers for it
            await bench.recorder.stop()
        await bench.advisor.close()
        running.cancel()
        return {**told, **reply}

    told = asyncio.run(taught())
    assert (tmp_path / "sessions" / "four" / "closed.json").exists()
    assert "internal error in recording: LookupError: a bug" in told["trouble"]
    assert told["sample"] == 1


def test_the_advising_process_tells_a_fault_of_ours_and_lives(monkeypatch, tmp_path):
    def faulty(*_: object, **__: object) -> None:
        raise LookupError("a bug")

    monkeypatch.setattr(advising, "advise_folder", faulty)
    line = answer_line(f'{{"folder": "{tmp_path}", "policy": "fixed"}}')
    assert "internal error in advise: LookupError: a bug" in line


def test_the_advising_process_answers_for_folders_that_are_not_there(tmp_path):
    line = answer_line(f'{{"folder": "{tmp_path}/none", "policy": "fixed"}}')
    assert "not a session" in line
    with pytest.raises(InputError, match="choose one of"):
        advising.policy_called("folow")


def test_four_axes_are_coached_without_tilt():
    sim = Simulation(4, one_axis=True)
    recording = sim.record(looks=4, spins=4, wrists=[sim.wrist(1.5) for _ in range(6)])
    advice = advise_session(recording, Policy.FOLLOW)
    assert (
        "the TCP along (0.00, 0.00, 1.00) of the flange"
        in (advice.to_json()["unknown_but_irrelevant"])
    )
    assert advice.trouble == ""
    pose = advice.best.base_from_wrist
    assert pose is None or pose.rotation[2, 2] == pytest.approx(-1)


def test_touches_of_the_turned_object_are_asked_for_and_taken(tmp_path: Path):
    """With real pictures: a centre that CAD does not know well, measured by what the advice asks for."""
    world = World(Layout(), 6, CellNoise())
    rehearsal = Rehearsal(world, facts_of(world, tmp_path))
    taught = rehearsal.teach(looks=4, spins=4, tilted=0, points=0)
    spec = replace(taught.facts.object, center_sigma_mm=1.0)
    open_center = replace(taught, facts=replace(taught.facts, object=spec))
    before = advise_session(open_center, Policy.FIXED)
    assert before.best is not None
    assert before.best.sentence.startswith("turn the object to 180 degrees and touch P")
    rehearsal.turn(np.pi)
    upright = open_center.touches[0].base_from_wrist.rotation
    more = tuple(rehearsal.touch(name, upright) for name in ("P1", "P3", "P5"))
    after = advise_session(
        replace(open_center, touches=(*open_center.touches, *more)), Policy.FIXED
    )
    assert after.trouble == ""
    assert not [one for one in after.findings if one.fatal]
    assert max(after.predicted_mm.values()) < 0.5 * max(before.predicted_mm.values())
