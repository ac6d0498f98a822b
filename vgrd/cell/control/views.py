"""What people look at: pictures, registers, answers, calibrations, sessions. Nothing here changes anything."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.cell.control.lines import (
    Arguments,
    optional_number,
    optional_text,
    optional_whole,
    text_argument,
)
from vgrd.cell.control.live_picture import (
    LONGEST_WAIT_S,
    NARROWEST_PX,
    WAIT_S,
    WIDEST_PX,
    WIDTH_PX,
    LivePicture,
)
from vgrd.cell.control.robot_view import robot_view
from vgrd.cell.control.server import Operation
from vgrd.cell.feeds import GateFeed
from vgrd.cell.measuring import Measuring, Sight
from vgrd.cell.recording.teaching import PICTURE_TIMEOUT_S, Teaching
from vgrd.cell.serving.activation import Activation
from vgrd.cell.serving.service import Serving
from vgrd.clock import Clock
from vgrd.errors import ControlError, DeviceUnavailable, TagNotSeen, VgrdError
from vgrd.geometry import Pose, log_rotation
from vgrd.model import CameraPlace, FlangeTag, Policy
from vgrd.solving.shelf import calibration_list, session_list

DAYS, MOST_DAYS = 14.0, 90.0  # of the diary: a season is kept, and two weeks are read at a glance


class Views:
    """Operations that only tell; `table` maps names to them."""

    def __init__(
        self,
        measuring: Measuring,
        serving: Serving,
        teaching: Teaching,
        activation: Activation,
        gate: GateFeed,
        clock: Clock,
    ) -> None:
        self._measuring, self._serving, self._teaching = measuring, serving, teaching
        self._activation, self._gate, self._clock = activation, gate, clock
        self._picture = LivePicture(measuring, clock)
        self._known: dict[str, dict[str, Any]] = {}
        self.diary: Callable[[float], Mapping[str, Any]] = lambda _: {}

    def table(self) -> Mapping[str, Operation]:
        """Operations by name."""
        return {
            "picture": Operation(self._newest_picture, ("after", "wait_s", "width_px")),
            "registers": Operation(self._registers),
            "answers": Operation(self._answers),
            "diary": Operation(self._diary, ("days",)),
            "calibrations": Operation(self._calibrations),
            "difference": Operation(self._difference, ("calibration", "with")),
            "sessions": Operation(self._sessions),
        }

    async def _newest_picture(self, arguments: Arguments) -> Mapping[str, Any]:
        wait_s, width_px = (
            optional_number(arguments, "wait_s"),
            optional_whole(arguments, "width_px"),
        )
        wait_s = WAIT_S if wait_s is None else wait_s
        width_px = WIDTH_PX if width_px is None else width_px
        if not 0 <= wait_s <= LONGEST_WAIT_S:
            raise ControlError(f"wait_s {wait_s:g}: 0 to {LONGEST_WAIT_S:g} seconds")
        if not NARROWEST_PX <= width_px <= WIDEST_PX:
            raise ControlError(f"width_px {width_px}: {NARROWEST_PX} to {WIDEST_PX} pixels")
        return await self._picture.newest(optional_whole(arguments, "after"), wait_s, width_px)

    async def _registers(self, _: Arguments) -> Mapping[str, Any]:
        report, now_s = self._gate.poll(), self._clock.monotonic()
        if report is None or not report.registers:
            raise DeviceUnavailable("the gate has not told yet what a robot reads: ask again")
        return robot_view(report, self._gate.stamp_s, now_s, self._serving.fault())

    async def _answers(self, _: Arguments) -> Mapping[str, Any]:
        return self._serving.history.to_json()

    async def _diary(self, arguments: Arguments) -> Mapping[str, Any]:
        days = optional_number(arguments, "days")
        days = DAYS if days is None else days
        if not 0 < days <= MOST_DAYS:
            raise ControlError(f"days {days:g}: above 0, up to {MOST_DAYS:g}")
        return self.diary(days)

    async def _calibrations(self, _: Arguments) -> Mapping[str, Any]:
        """As they are stored; active is what serves, which may be none though one was put in use."""
        told = await asyncio.to_thread(calibration_list, self._activation.store, self._known)
        served = None if self._serving.calibration is None else self._serving.calibration.id
        rows = [{**row, "active": row["id"] == served} for row in told["calibrations"]]
        return {**told, "active": served, "calibrations": rows}

    async def _sessions(self, _: Arguments) -> Mapping[str, Any]:
        writer = self._teaching.recorder.writer
        name = None if writer is None else writer.header.name
        folder = Path(self._activation.store.path).parent
        return {"sessions": await asyncio.to_thread(session_list, folder, name)}

    async def _difference(self, arguments: Arguments) -> Mapping[str, Any]:
        """By target how far apart two calibrations put the flange, for one picture; `with`: none is the active."""
        name, base = text_argument(arguments, "calibration"), optional_text(arguments, "with")
        load = self._activation.store.load
        active = self._serving.calibration if base is None else await asyncio.to_thread(load, base)
        if active is None:
            raise ControlError("no calibration is in use, so there is nothing to compare with")
        other = await asyncio.to_thread(load, name)
        sight = await self._measuring.fresh(PICTURE_TIMEOUT_S)
        if sight.tag_b is None:
            raise TagNotSeen("tag B on the object is not in the picture: move the arm aside")
        targets = {t: self._apart(active, other, t, sight) for t in active.facts.object.targets}
        return {"with": active.id, "calibration": other.id, "targets": targets}

    def _apart(
        self, active: Calibration, other: Calibration, target: str, sight: Sight
    ) -> Mapping[str, Any]:
        policy = self._serving.limits.policy
        try:
            now, then = (self._served(one, target, policy, sight) for one in (active, other))
        except (
            VgrdError
        ) as err:  # a target that one of them does not know, a picture that one contradicts
            return {"mm": None, "deg": None, "trouble": str(err)}
        mm = float(np.linalg.norm(then.translation - now.translation))
        deg = float(np.degrees(np.linalg.norm(log_rotation(then.rotation @ now.rotation.T))))
        return {"mm": mm, "deg": deg, "trouble": ""}

    def _served(self, calibration: Calibration, target: str, policy: Policy, sight: Sight) -> Pose:
        place = CameraPlace(self._serving.cameras.stability, FlangeTag.of(sight.observation()))
        if sight.tag_b is None:
            raise TagNotSeen("tag B is not in the picture")
        return expected_coordinate(
            calibration, target, sight.tag_b, policy, None, place
        ).base_from_wrist
