"""The control operations of the cell: names, arguments, and what they call."""

import asyncio
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.calibration.adoption import link_called
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.insertion import insertion_of
from vgrd.calibration.places import base_from_tag, followed_point, work_tip
from vgrd.calibration.stated_error import THIS_PICTURE, u95_in_words
from vgrd.cell.control.lines import (
    Arguments,
    flag_argument,
    optional_number,
    optional_text,
    optional_whole,
    text_argument,
    whole_argument,
)
from vgrd.cell.control.live_picture import side_px
from vgrd.cell.control.results import Results
from vgrd.cell.control.scene import Scene
from vgrd.cell.control.server import Operation
from vgrd.cell.control.versions import Versions
from vgrd.cell.control.views import Views
from vgrd.cell.feeds import GateFeed
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.recording.teaching import PICTURE_TIMEOUT_S, Teaching
from vgrd.cell.recording.wizard import Wizard
from vgrd.cell.serving.activation import Activation
from vgrd.cell.serving.latches import LatchBook
from vgrd.cell.serving.limits import excess_of, summary, words_of
from vgrd.cell.serving.service import Serving
from vgrd.cell.serving.trials import Trials
from vgrd.clock import Clock
from vgrd.config.resolved import Resolved
from vgrd.devices import FlangeReading
from vgrd.errors import (
    CalibrationError,
    ControlError,
    InputError,
    StaleVersion,
    TagNotSeen,
)
from vgrd.geometry import Array, exp_rotation
from vgrd.geometry.pose_formats import mm_and_degrees
from vgrd.geometry.rotation_formats import rotvec_near
from vgrd.registers.limits import LIMIT_STATUS
from vgrd.solving.advisor import FULL_S, WAIT_S, policy_called
from vgrd.solving.goodness import levels_in_words
from vgrd.solving.servable import places_without_cad
from vgrd.solving.shelf import former_calibration
from vgrd.store.sessions import SampleKind, list_sessions, session_directory

# What the numbers of `ec` are: people type them into a move of the TCP that is active on the pendant.
EC_IS = "base_from_wrist: the flange, not the TCP of the pendant, in the robot's base"
_MEANT = ("session", "calibration")  # whose verification it is
SOLVE_TIMEOUT_S = 280.0  # below the 300 s of `vgrd solve`, which so gets this reason


class Operations:
    """Everything the control API can do; `table` maps names to coroutines."""

    def __init__(
        self,
        latches: LatchBook,
        measuring: Measuring,
        serving: Serving,
        teaching: Teaching,
        activation: Activation,
        runtime_dir: Path,
        state_dir: Path,
        clock: Clock,
        resolved: Resolved,
    ) -> None:
        self.latches = latches
        self.measuring = measuring
        self.serving = serving
        self.teaching = teaching
        self.activation = activation
        self.state_dir = state_dir
        self.clock = clock
        self.resolved = resolved
        self.gate = GateFeed(runtime_dir, clock)
        self.trials = Trials(serving, state_dir, clock)
        self.versions = Versions(teaching, serving, self.trials)
        self.wizard = Wizard(teaching, activation, serving, clock)
        self.views = Views(measuring, serving, teaching, activation, self.gate, clock)
        self.results = Results(state_dir)
        self.scene = Scene(measuring, serving, self.wizard)
        self.disk: Callable[[], Mapping[str, Any]] = dict
        self.pedal: Callable[[], Mapping[str, Any]] = dict

    def table(self) -> Mapping[str, Operation]:
        """Operations by name; those that are guarded change something, and may name a version."""
        teaching, guarded = self.teaching, self.versions.guarded

        return {
            "status": Operation(self._status),
            "record.start": guarded(
                lambda a: teaching.start(
                    text_argument(a, "plan", "joint"),
                    optional_text(a, "session"),
                    harvest=flag_argument(a, "harvest", default=True),
                ),
                *("plan", "session", "harvest"),
            ),
            "record.stop": guarded(lambda _: teaching.stop()),
            "look": guarded(lambda _: teaching.look()),
            "spin": guarded(lambda _: teaching.spin()),
            "touch": guarded(
                lambda a: teaching.touch(text_argument(a, "target"), SampleKind.TOUCH), "target"
            ),
            "verify": guarded(self._verify, "target", *_MEANT),
            "point": guarded(lambda a: teaching.point(text_argument(a, "name")), "name"),
            "undo": guarded(self._undo, "kind", "sample", *_MEANT),
            "retag": guarded(
                lambda a: teaching.retag(whole_argument(a, "sample"), text_argument(a, "target")),
                *("sample", "target"),
            ),
            "record.samples": Operation(self._samples),
            "advise": Operation(self._advise, ("policy", "tilt_deg", "yaw_deg", "wait_s")),
            "solve": Operation(self._solve, ("session",)),
            "activate": guarded(self._activate, "calibration", "by"),
            "rollback": guarded(self._roll_back, "active", "by"),
            "ec": Operation(self._ec, ("target", "policy", "work_rotvec_deg")),
            "confirm": guarded(self._confirm, "accept", "by"),
            "teaching": Operation(self._teaching),
            "trials": Operation(lambda _: self.trials.tell()),
            **self.views.table(),
            **self.results.table(),
            **self.scene.table(),
        }

    async def _status(self, _: Arguments) -> Mapping[str, Any]:
        sight, now, fault = (
            self.measuring.sight,
            self.measuring.sight_of_now(),
            self.serving.fault(),
        )
        calibration = self.serving.calibration
        return {
            "serving": fault is None,
            "fault": None if fault is None else {"status": fault[0].name, "reason": fault[1]},
            "calibration": None if calibration is None else calibration.id,
            "without_cad": {} if calibration is None else places_without_cad(calibration),
            "limits": {}
            if calibration is None
            else summary(calibration, self.serving.limits.bounds),
            "noise": {} if calibration is None else levels_in_words(calibration),
            "robot": self.measuring.robot_trouble() or "ok",
            "camera": self.measuring.camera_trouble() or "ok",
            "camera_moved": self.serving.faults.knock or None,
            "picture_age_s": None
            if sight is None
            else round(self.clock.monotonic() - sight.stamp_s, 3),
            "robot_at_rest": None if now is None else now.is_at_rest,
            **_reading_words(self.measuring.reading()),
            "tag_a_seen": None if now is None else now.tag_a is not None,
            "tag_b_seen": None if now is None else now.tag_b is not None,
            "tags": self._tags(now),
            "targets": list(self.measuring.facts.object.targets),
            "answer": self.serving.answer.status.name,
            "moved_told_within_s": round(self.serving.vouch.span_s, 3),
            "recording": self.teaching.status(),
            "cell_file": self.resolved.source,
            "cell_file_loaded_unix_s": self.resolved.loaded_unix_s,
            "disk": self.disk(),
            "pedal": self.pedal(),
            "processes": self._processes(),
        }

    def _tags(self, sight: Sight | None) -> Mapping[str, Any]:
        """The tags that are wanted, and how large each is in a picture."""
        facts = self.measuring.facts
        seen = (None, None) if sight is None else (sight.tag_a, sight.tag_b)
        wanted = ("a", facts.tag_a), ("b", facts.tag_b)
        return {
            name: {
                "wanted": f"{tag.family} id {tag.id}",
                "side_px": None if found is None else round(side_px(found.corners_px)),
            }
            for (name, tag), found in zip(wanted, seen, strict=True)
            if tag is not None
        }

    def _processes(self) -> Mapping[str, str]:
        """One line per process of the gate's table."""
        report = self.gate.poll()
        rows = report.processes if report else ()
        return {
            row.name: f"{row.state}, pid {row.pid}, started {row.starts} times, {row.health}"
            + (f": {row.detail}" if row.detail else "")
            for row in rows
        }

    async def _advise(self, arguments: Arguments) -> Mapping[str, Any]:
        limits: dict[str, str | float] = {}
        for name in ("tilt_deg", "yaw_deg"):
            if (value := optional_number(arguments, name)) is not None:
                limits[name] = value
        if (policy := optional_text(arguments, "policy")) is not None:
            limits["policy"] = policy_called(policy).value
        wait_s = optional_number(arguments, "wait_s")
        if wait_s is None:
            wait_s = WAIT_S
        if not 0 <= wait_s <= FULL_S:
            raise ControlError(f"wait_s {wait_s:g}: 0 to {FULL_S:g} seconds")
        return await self.teaching.advise(wait_s, **limits)

    async def _solve(self, arguments: Arguments) -> Mapping[str, Any]:
        """Solve a session, one at a time: a button that is pressed twice asks for one result."""
        name = optional_text(arguments, "session") or await self._last_session()
        if self.wizard.solving:
            raise ControlError(
                f"session {self.wizard.solving} is being solved: wait for its result"
            )
        self.wizard.solving = name
        try:
            return await self._solved(name)
        finally:
            self.wizard.solving = ""

    async def _solved(self, name: str) -> Mapping[str, Any]:
        """Run the solver in a process of its own: it can be killed, and never delays an answer."""
        folder = session_directory(self.state_dir, name)
        limits = self.serving.limits
        command = ["-m", "vgrd.solving.session", str(folder), str(self.state_dir)]
        command += [str(limits.max_u95_mm), limits.policy.value]
        command += [",".join(map(str, self.serving.cameras.stability.tolist()))]
        process = await asyncio.create_subprocess_exec(
            sys.executable, *command, stdout=asyncio.subprocess.PIPE
        )
        try:
            async with asyncio.timeout(SOLVE_TIMEOUT_S):
                output, _ = await process.communicate()
        except TimeoutError as err:
            raise CalibrationError(f"not solved within {SOLVE_TIMEOUT_S:.0f} s") from err
        finally:
            if process.returncode is None:
                process.kill()
        if process.returncode != 0:
            raise ControlError(f"the solver died with {process.returncode}; its log says why")
        reply = json.loads(output)
        if not reply["ok"]:
            self.wizard.rejected[name] = reply["message"]
            raise ControlError(reply["message"], error=reply["error"])
        result = dict(reply["result"])
        fatal = [one["message"] for one in result["verdict"]["findings"] if one["fatal"]]
        self.wizard.rejected |= {name: fatal[0]} if fatal else {}
        return result

    async def _last_session(self) -> str:
        names = await asyncio.to_thread(list_sessions, self.state_dir)
        if not names:
            raise InputError("there is no recorded session to solve: vgrd record start")
        return names[-1]

    async def _activate(self, arguments: Arguments) -> Mapping[str, Any]:
        name = text_argument(arguments, "calibration")
        return await self.activation.activate(name, text_argument(arguments, "by", ""))

    async def _roll_back(self, arguments: Arguments) -> Mapping[str, Any]:
        """Back to the former calibration; `active`: the one that is left, StaleVersion where another is in use."""
        replaced = self.serving.calibration  # as `calibrations` tells it: what serves
        active = "" if replaced is None else replaced.id
        if (left := optional_text(arguments, "active")) not in (None, active):
            raise StaleVersion(
                f"not rolled back: {left or 'no calibration'} was to be left, and {active or 'none'} "
                "is in use by now: look again"
            )
        former = await asyncio.to_thread(former_calibration, self.activation.store)
        told = await self.activation.activate(former, text_argument(arguments, "by", ""))
        return {**told, "former": None if replaced is None else replaced.id}

    async def _teaching(self, _: Arguments) -> Mapping[str, Any]:
        return {"version": self.versions.now, **await self.wizard.state()}

    async def _ec(self, arguments: Arguments) -> Mapping[str, Any]:
        target = text_argument(arguments, "target")
        policy = policy_called(
            optional_text(arguments, "policy") or self.serving.limits.policy.value
        )
        work = _orientation(arguments)
        calibration, fault = self.serving.calibration, self.serving.fault()
        if calibration is None or fault is not None:
            raise ControlError(f"not serving: {fault[1] if fault else 'no calibration'}")
        sight = await self.measuring.fresh(PICTURE_TIMEOUT_S)
        fault = self.serving.fault()  # of this very picture, or of what came while it was taken
        if fault is not None or self.serving.calibration is not calibration:
            raise ControlError(f"not serving: {fault[1] if fault else 'another calibration came'}")
        if sight.tag_b is None:
            raise TagNotSeen("tag B on the object is not in the picture")
        expected = expected_coordinate(
            calibration, target, sight.tag_b, policy, work, self.serving.cameras.place(sight)
        )
        pose = expected.base_from_wrist
        tag_pose = base_from_tag(calibration, sight.tag_b, expected.taught_from_camera)
        bounds = self.serving.limits.bounds
        if excess := excess_of(calibration, target, pose, policy, bounds, tag_pose):
            status = LIMIT_STATUS[excess.code]
            raise ControlError(
                f"{excess.words(target)} (registers: STATUS {status:d} {status.name}, DETAIL {excess.code:d})"
            )
        configured = self.teaching.facts.object.targets.get(target)
        clearance_mm = None if configured is None else configured.clearance_mm
        odds = insertion_of(expected, calibration.facts.tool, clearance_mm)
        rotvec = rotvec_near(pose.rotation, calibration.taught_rotvec(target))
        tip = None if work_tip(calibration) is None else followed_point(calibration, pose)
        return {
            "target": target,
            "policy": policy.value,
            "pose": EC_IS,
            "position_mm": pose.translation.tolist(),
            "rotvec_deg": np.degrees(rotvec).tolist(),
            "tip_in_base_mm": None if tip is None else tip.tolist(),
            "u95_mm": expected.u95_mm,
            "u95_includes": u95_in_words(
                THIS_PICTURE, policy, int(calibration.residuals.get("holes_used", 0))
            ),
            "age_s": round(self.clock.monotonic() - sight.stamp_s, 3),
            "calibration": calibration.id,
            "limits": words_of(bounds.of(target)),
            **({} if odds is None else {"insertion": odds.to_json()}),
        }

    async def _samples(self, _: Arguments) -> Mapping[str, Any]:
        return self.teaching.samples()

    async def _verify(self, arguments: Arguments) -> Mapping[str, Any]:
        """In the open session; without one, of the calibration in use."""
        target = text_argument(arguments, "target")
        if self._means_calibration(arguments):
            tip = await self.teaching.tip_at(target)
            return await self.trials.add(tip) | dict(await self.activation.bear_out(tip))
        reply = await self.teaching.touch(target, SampleKind.VERIFY)
        touch = self.teaching.last_touch
        return reply | dict(await self.activation.bear_out(touch) if touch else {})

    async def _undo(self, arguments: Arguments) -> Mapping[str, Any]:
        """In the open session; without one, the last verification of the calibration in use."""
        kind, sample = optional_text(arguments, "kind"), optional_whole(arguments, "sample")
        means_calibration = self._means_calibration(arguments)
        if means_calibration and sample is None and kind in (None, SampleKind.VERIFY.value):
            return await self.trials.undo()
        return await self.teaching.undo(kind, sample)

    def _means_calibration(self, arguments: Arguments) -> bool:
        """Whether a command is of the calibration in use, not of a session: it may name either.

        Raises StaleVersion where what it names is not what it would be done to.
        """
        writer, calibration = self.teaching.recorder.writer, self.serving.calibration
        opened = "" if writer is None else writer.header.name
        active = "" if calibration is None else calibration.id
        session, named = (optional_text(arguments, name) for name in _MEANT)
        is_other = named is not None and (opened != "" or named != active)
        if is_other or session not in (None, opened):
            meant = f"calibration {named}" if session is None else f"session {session}"
            raise StaleVersion(
                f"not done: it was of {meant}; session {opened or 'none'} is open, calibration "
                f"{active or 'none'} is in use: look again"
            )
        return session is None and not opened and (active != "" or named is not None)

    async def _confirm(self, arguments: Arguments) -> Mapping[str, Any]:
        adopted: Mapping[str, Any] = {}
        if (name := optional_text(arguments, "accept")) is not None:
            by = text_argument(arguments, "by", "")
            adopted = await self.activation.adopt(link_called(name), by)
        self.serving.confirm(is_adopted=bool(adopted))
        await self.latches.settled()
        fault = self.serving.fault()
        return {"confirmed": True, "fault": None if fault is None else fault[1], **adopted}


def _reading_words(reading: FlangeReading | None) -> Mapping[str, Any]:
    """Flange and active TCP as the robot tells them, None where it does not."""
    poses = (None, None) if reading is None else (reading.base_from_wrist, reading.wrist_from_tcp)
    return {
        name: None if pose is None else mm_and_degrees(pose)
        for name, pose in zip(("flange", "tcp"), poses, strict=True)
    }


def _orientation(arguments: Arguments) -> Array | None:
    """base_from_wrist (3, 3) from argument work_rotvec_deg, "RX RY RZ"; None without it."""
    text = optional_text(arguments, "work_rotvec_deg")
    if text is None:
        return None
    try:
        degrees = [float(word) for word in text.split()]
    except ValueError:
        degrees = []
    if len(degrees) != 3 or not all(map(math.isfinite, degrees)):
        raise InputError(f"work_rotvec_deg {text!r}: three numbers in degrees, as in '180 0 0'")
    return exp_rotation(np.radians(degrees))
