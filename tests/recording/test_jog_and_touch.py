"""`vgrd record start --plan joint`, jog, `vgrd touch`: a whole teaching, and what undo does to it."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from fakes.studies.sessions import TILT_RAD
from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.control.lines import flag_argument
from vgrd.cell.measuring import Sight
from vgrd.cell.recording.questions import OpenQuestions
from vgrd.cell.recording.recorder import Recorder
from vgrd.cell.recording.teaching import Teaching
from vgrd.config.cell_file import TouchSection
from vgrd.devices import CameraImage, FlangeReading
from vgrd.devices.stillness import RestLimits
from vgrd.errors import ControlError, InputError, NotSteady
from vgrd.geometry import Pose
from vgrd.model import Observation, Policy, Stability
from vgrd.solving.session import solve_session
from vgrd.store.sessions import SampleKind, load_session

PIXELS = np.zeros((4, 6), np.uint8)
TURNS = (1.2, 2.4, 3.6, 4.8)


class Bench:
    """The cell as a teaching session meets it: an arm of the simulation, its pictures as they come."""

    def __init__(self, folder, cell=None, **facts):
        self.cell = cell or Simulation(8)
        self.recorder = Recorder(folder, ManualClock())
        facts = replace(self.cell.facts(), **facts)
        self.teaching = Teaching(self, self.recorder, facts, TouchSection())
        self.robot, self.limits = self, RestLimits()
        self.tool = Pose.identity()
        self.now: Observation | None = None

    def newest(self, within_s):
        return FlangeReading(Pose.identity(), self.tool, 1000.0, 1000.0)

    async def rest(self):
        return self.now.base_from_wrist

    async def fresh(self, timeout_s):
        self.show(self.now)  # the measuring loop tells every picture to all who listen
        return self.sight(self.now)

    def sight(self, seen):
        image = CameraImage(PIXELS, seen.stamp_s, 0)
        return Sight(image, seen.tag_a, seen.tag_b, seen.base_from_wrist, None, seen.rest_since_s)

    def show(self, seen):
        self.now = seen
        self.teaching.on_sight(self.sight(seen))

    def stop(self, pose, angle_rad=0.0):
        """The arm stands for two pictures."""
        for seen in self.cell.watch(pose, angle_rad, 2):
            self.show(seen)

    def above(self, target, R):
        """A place of the flange on the way to a target."""
        return Pose(R, self.cell.flange(target, 0.0, R) + np.array([5.0, -8.0, 80.0]))

    async def touch(self, target, R=WORK_ROTATION):
        self.stop(self.above(target, R))
        seen = self.cell.touch(target, R).observation
        self.show(replace(seen, rest_since_s=seen.stamp_s))
        self.show(self.now)
        return await self.teaching.touch(target, SampleKind.TOUCH)

    async def counts(self):
        """What the session holds, once all that was harvested is written."""
        await self.recorder.call(lambda _: None)
        return self.teaching.status()


def session_of(bench, steps, **options):
    """Record a session of plan joint; its folder."""

    async def run():
        await bench.teaching.start("joint", "jogged", **options)
        await steps()
        await bench.recorder.call(lambda _: None)
        return await bench.teaching.stop()

    asyncio.run(run())
    return bench.teaching.last_session


def test_jog_and_touch_alone_is_a_teaching_that_serves(tmp_path):
    bench = Bench(tmp_path)
    cell = bench.cell

    async def steps():
        bench.stop(cell.standing)
        for angle in TURNS:
            bench.stop(cell.standing, angle)
        wrists = [WORK_ROTATION] * 3 + [cell.wrist(TILT_RAD) for _ in range(3)]
        for k, R in enumerate(wrists):
            reply = await bench.touch(f"P{k + 1}", R)
        assert reply["have"]["touch"] == 6
        assert reply["harvested"]["spin"] == len(TURNS)
        assert reply["have"]["look"] == reply["harvested"]["look"] >= 4

    folder = session_of(bench, steps)
    result = solve_session(folder)
    assert result["verdict"]["ok"], result["verdict"]
    assert result["harvested"]["spin"] == len(TURNS)

    calibration = calibrate_system(load_session(folder).recording)
    misses = []
    for _ in range(20):
        request = cell.request()
        served = expected_coordinate(
            calibration, request.target, request.seen.tag_b, Policy.FIXED
        ).base_from_wrist
        misses.append(float(np.linalg.norm(cell.miss(request, served))))
    assert np.median(misses) < 0.4


def test_a_rest_that_is_touched_counts_once(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        seen = bench.cell.touch("P1", WORK_ROTATION).observation
        seen = replace(seen, rest_since_s=seen.stamp_s)
        bench.show(seen)
        bench.show(seen)
        assert (await bench.counts())["have"] == {"look": 1}
        reply = await bench.teaching.touch("P1", SampleKind.TOUCH)
        assert reply["have"] == {"touch": 1}
        assert reply["harvested"] == {}
        bench.show(seen)
        bench.show(seen)
        assert (await bench.counts())["have"] == {"touch": 1}

    session = load_session(session_of(bench, steps))
    assert (len(session.recording.looks), len(session.recording.touches)) == (0, 1)
    assert session.harvested == {}


def test_undo_takes_back_what_was_asked_for_unless_another_kind_is_named(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        bench.stop(bench.cell.standing)
        bench.stop(bench.cell.standing, 1.0)
        await bench.counts()
        with pytest.raises(InputError, match="no sample has been taught"):
            await bench.teaching.undo()
        await bench.touch("P1")
        bench.stop(bench.above("P4", WORK_ROTATION))
        assert (await bench.counts())["harvested"] == {"look": 3, "spin": 1}
        undone = await bench.teaching.undo()
        assert (undone["undone"], undone["harvested"]["look"]) == ("touch", 3)
        assert undone["was_harvested"] is False
        undone = await bench.teaching.undo("spin")
        assert (undone["undone"], undone["was_harvested"]) == ("spin", True)
        undone = await bench.teaching.undo("harvested")
        assert (undone["undone"], undone["have"]) == ("look", {"look": 2})
        with pytest.raises(InputError, match="choose one of look, spin, touch"):
            await bench.teaching.undo("looks")
        with pytest.raises(InputError, match="no point has been taught"):
            await bench.teaching.undo("point")

    session = load_session(session_of(bench, steps))
    assert session.harvested == {"look": 2}
    assert len(session.recording.looks) == 2


def test_samples_are_undone_and_named_anew_by_the_number_of_their_reply(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        first = await bench.touch("P1")
        second = await bench.touch("P2")
        bench.stop(bench.above("P4", WORK_ROTATION))
        await bench.counts()
        listed = bench.teaching.samples()["samples"]
        (harvested,) = [n for n, words in listed.items() if words == "look, harvested"][-1:]
        undone = await bench.teaching.undo(number=int(harvested))
        assert (undone["undone"], undone["was_harvested"]) == ("look", True)
        undone = await bench.teaching.undo(number=first["sample"])
        assert (undone["undone"], undone["target"], undone["have"]["touch"]) == ("touch", "P1", 1)
        renamed = await bench.teaching.retag(second["sample"], "P6")
        assert (renamed["retagged"], renamed["target"]) == ("touch", "P6")
        assert bench.teaching.samples()["samples"][str(second["sample"])] == "touch P6"
        with pytest.raises(InputError, match="there is no sample"):
            await bench.teaching.retag(first["sample"], "P6")
        with pytest.raises(InputError, match="unknown target 'P9'; the cell file has: P1"):
            await bench.teaching.retag(second["sample"], "P9")
        with pytest.raises(InputError, match="either the last touch or sample 3"):
            await bench.teaching.undo("touch", 3)

    session = load_session(session_of(bench, steps))
    assert [touch.target for touch in session.recording.touches] == ["P6"]


def test_a_touch_under_the_wrong_name_is_questioned_in_its_reply_until_it_is_mended(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        for name in ("P1", "P2", "P3", "P4"):
            assert "questions" not in await bench.touch(name)
        seen = bench.cell.touch("P5", WORK_ROTATION).observation
        bench.show(replace(seen, rest_since_s=seen.stamp_s))
        reply = await bench.teaching.touch("P6", SampleKind.TOUCH)
        number = reply["sample"]
        assert f"vgrd retag {number} P5" in reply["questions"][str(number)]
        assert bench.teaching.status()["questions"] == reply["questions"]
        renamed = await bench.teaching.retag(number, "P5")
        assert "questions" not in renamed
        again = await bench.teaching.retag(number, "P6")
        assert again["questions"] == reply["questions"]
        assert "questions" not in await bench.teaching.undo(number=number)

    session_of(bench, steps)


def test_the_calibration_in_use_questions_a_first_touch_far_off_and_the_tag_that_is_hidden(
    tmp_path,
):
    cell = Simulation(8)
    wrists = [WORK_ROTATION] * 6 + [cell.wrist(TILT_RAD) for _ in range(4)]
    calibration = calibrate_system(cell.record(wrists=wrists))
    bench = Bench(tmp_path, cell)
    bench.teaching.questions = OpenQuestions(lambda: calibration)

    async def steps():
        seen = cell.touch("P4", WORK_ROTATION).observation
        bench.show(replace(seen, tag_a=None))
        reply = await bench.teaching.touch("P1", SampleKind.TOUCH)
        told = reply["questions"][str(reply["sample"])]
        assert told.startswith("the calibration puts the tip 160 mm from P1, nearest target P4 (")
        assert "tag A is not in the picture: turn it to the camera" in told
        assert reply["have"]["touch"] == 1

    session_of(bench, steps, harvest=False)


def test_a_sample_of_the_same_place_is_told_and_does_not_count(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        first, other = bench.cell.looks(2)
        bench.now = first
        assert "remark" not in await bench.teaching.look()
        again = await bench.teaching.look()
        assert again["remark"] == "the flange did not move since sample 1: not counted"
        assert (again["have"], again["missing"]["look"]) == ({"look": 1}, 7)
        bench.now = other
        assert (await bench.teaching.look())["have"] == {"look": 2}
        assert (await bench.teaching.undo(number=1))["have"] == {
            "look": 2
        }  # the second counts now
        for angle, spins in ((0.0, 1), (0.0, 1), (1.0, 2)):
            bench.now = bench.cell.observe(bench.cell.standing, angle)
            reply = await bench.teaching.spin()
            assert reply["have"]["spin"] == spins
        bench.now = bench.cell.touch("P1", WORK_ROTATION).observation
        await bench.teaching.touch("P1", SampleKind.TOUCH)
        reply = await bench.teaching.touch("P1", SampleKind.TOUCH)
        assert reply["have"]["touch"] == 1
        assert "not counted" in reply["remark"]

    session_of(bench, steps, harvest=False)


def test_whether_to_harvest_is_true_or_false():
    assert flag_argument({}, "harvest", default=True) is True
    assert flag_argument({"harvest": False}, "harvest", default=True) is False
    with pytest.raises(ControlError, match="'harvest' must be true or false, got 'no'"):
        flag_argument({"harvest": "no"}, "harvest", default=True)


def test_nothing_is_harvested_where_nobody_wants_it(tmp_path):
    for name, options in (("off", {"harvest": False}), ("on", {})):
        bench = Bench(tmp_path / name)

        async def steps(bench=bench):
            bench.stop(bench.cell.standing)

        session = load_session(session_of(bench, steps, **options))
        assert len(session.recording.looks) == (name == "on")

    bench = Bench(tmp_path / "special")

    async def special():
        await bench.teaching.start("special", "s")
        bench.stop(bench.cell.standing)
        assert (await bench.counts())["have"] == {}
        await bench.teaching.stop()
        bench.stop(bench.cell.standing)  # nobody records

    asyncio.run(special())


def test_nothing_is_harvested_with_another_tcp_nor_while_the_disk_is_full(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        bench.tool = Pose.from_rotvec((0, 0, 0), (0, 0, 5.0))
        bench.stop(bench.cell.standing)
        bench.tool = Pose.identity()
        bench.recorder.paused = "the disk is full"
        bench.stop(bench.cell.standing)
        assert (await bench.counts())["have"] == {}
        bench.recorder.paused = ""
        bench.stop(bench.cell.standing)
        assert (await bench.counts())["have"] == {"look": 1}

    session_of(bench, steps)


def test_pictures_of_a_moving_arm_are_no_rest(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        for seen in bench.cell.watch(bench.cell.standing, 0.0, 2):
            moving = replace(bench.sight(seen), base_from_wrist=None, unpaired=NotSteady("moved"))
            bench.teaching.on_sight(moving)
        assert (await bench.counts())["have"] == {}

    session_of(bench, steps)


def test_a_movable_camera_is_taught_by_jogging_too(tmp_path):
    bench = Bench(tmp_path, camera_stability=Stability.MOVABLE)

    async def steps():
        bench.stop(bench.cell.standing)
        bench.stop(bench.cell.standing, 1.0)
        assert (await bench.counts())["have"] == {"spin": 2}

    session_of(bench, steps)


def test_an_object_that_was_lifted_by_hand_is_harvested_and_left_out_by_the_estimate(tmp_path):
    bench = Bench(tmp_path)
    cell = bench.cell

    async def steps():
        bench.stop(cell.standing)
        for angle in TURNS:
            bench.stop(cell.standing, angle)
        for seen in cell.watch(cell.standing, 2.0, 2):
            lift = Pose.from_rotvec((0.02, 0, 0), (0, 0, -15.0))
            lifted = replace(seen.tag_b, camera_from_tag=lift @ seen.tag_b.camera_from_tag)
            bench.show(replace(seen, tag_b=lifted))
        for k in range(6):
            await bench.touch(f"P{k + 1}", cell.wrist(TILT_RAD))

    recording = load_session(session_of(bench, steps)).recording
    assert len(recording.spins) == len(TURNS) + 1
    calibration = calibrate_system(recording)
    named = [f.message for f in calibration.verdict.findings if f.code == "spin_outlier"]
    assert any("spin 5 was left out" in message for message in named), calibration.verdict
    request = cell.request()
    served = expected_coordinate(calibration, request.target, request.seen.tag_b, Policy.FIXED)
    assert np.linalg.norm(cell.miss(request, served.base_from_wrist)) < 1.0


def test_an_arm_that_left_before_the_pictures_is_no_touch(tmp_path):
    """A foot presses and the hands move on: the place where they stop next is not the target."""
    bench = Bench(tmp_path)
    touch = bench.cell.touch("P1", WORK_ROTATION).observation
    (gone,) = bench.cell.watch(bench.above("P1", WORK_ROTATION), 0.0, 1)
    bench.now = touch

    async def rest():
        pose, bench.now = touch.base_from_wrist, gone
        return pose

    bench.rest = rest

    async def steps():
        with pytest.raises(NotSteady, match="moved on by"):
            await bench.teaching.touch("P1", SampleKind.TOUCH)

    folder = session_of(bench, steps)
    assert not load_session(folder).recording.touches


def test_a_second_press_in_the_same_rest_is_no_touch(tmp_path):
    bench = Bench(tmp_path)

    async def steps():
        await bench.touch("P1")
        with pytest.raises(NotSteady, match="has not moved since"):
            await bench.teaching.touch("P2", SampleKind.TOUCH, by_foot=True)

    folder = session_of(bench, steps)
    assert len(load_session(folder).recording.touches) == 1


def test_names_given_by_a_foot_need_one_that_was_said(tmp_path):
    """One press too few names every touch wrong, which six holes on a ring cannot tell."""
    for said in (None, "P6"):
        bench = Bench(tmp_path / str(said))

        async def steps(bench=bench, said=said):
            bench.stop(bench.cell.standing)
            for angle in TURNS:
                bench.stop(bench.cell.standing, angle)
            for k in range(6):
                name, place = f"P{k + 1}", f"P{(k + 1) % 6 + 1}" if said is None else f"P{k + 1}"
                bench.stop(bench.above(place, WORK_ROTATION))
                seen = bench.cell.touch(place, WORK_ROTATION).observation
                bench.show(replace(seen, rest_since_s=seen.stamp_s))
                bench.show(bench.now)
                await bench.teaching.touch(name, SampleKind.TOUCH, by_foot=True)
            if said is not None:
                await bench.teaching.touch(said, SampleKind.VERIFY)

        result = solve_session(session_of(bench, steps))
        codes = [one["code"] for one in result["verdict"]["findings"] if one["fatal"]]
        assert ("names_unproven" in codes) is (said is None), codes
