"""What became of the cell over weeks: by the hour how camera and tags moved, and every fault. No answer needs it."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog

from vgrd.cell.serving.faults import Fault, Faults
from vgrd.clock import Clock
from vgrd.errors import StoreError
from vgrd.geometry import Pose
from vgrd.model import LinkReport
from vgrd.store.files import read_document, write_document

FILE: Final = "diary.json"
LOOK_S: Final = 1.0  # a fault that is shorter may be missed here, not in the log
SAVE_S: Final = 60.0  # a power cut costs as much
HOUR_S: Final = 3600.0
MOST_HOURS: Final = 90 * 24  # chosen: a quarter of a year shows what a season does
MOST_FAULTS: Final = 500  # chosen: weeks of a cell that is used
TOLD_FAULTS: Final = 100  # at once: nobody reads more
_SCHEMA: Final = 1

log = structlog.get_logger()


class Diary:
    """Kept in one file of the state folder; what cannot be written is told once and tried again."""

    def __init__(self, state_dir: Path, faults: Faults, clock: Clock) -> None:
        self._path, self._faults, self._clock = state_dir / FILE, faults, clock
        self._hours: list[dict[str, Any]] = []
        self._changes: list[dict[str, Any]] = []
        self._seen: LinkReport | None = None
        self._samples: list[tuple[float, float, float]] = []  # of this hour: mm, mrad, misfit
        self._is_changed, self._trouble = False, ""

    async def run(self) -> None:
        """Look and save until cancelled."""
        await asyncio.to_thread(self.load)
        saved_s = self._clock.monotonic()
        while True:
            self.look()
            if self._clock.monotonic() - saved_s >= SAVE_S:
                await asyncio.to_thread(self.save)
                saved_s = self._clock.monotonic()
            await asyncio.sleep(LOOK_S)

    def load(self) -> None:
        """Read what was kept; a damaged file is set aside, not lost."""
        try:
            if not self._path.exists():
                return
            body = read_document(self._path, _SCHEMA)
        except StoreError as err:
            log.warning("diary_unreadable", reason=str(err))
            self._set_aside()
            return
        if isinstance(body, Mapping):
            self._hours, self._changes = list(body["hours"]), list(body["faults"])

    def _set_aside(self) -> None:
        try:
            self._path.replace(self._path.with_suffix(".damaged"))
        except OSError as err:
            log.warning("diary_not_set_aside", reason=str(err))

    def look(self) -> None:
        """Note what is so now."""
        self._note_fault(self._faults.current())
        report = self._faults.report
        if report is not None and report is not self._seen:
            self._seen = report
            self._note_drift(report)

    def _note_fault(self, fault: Fault | None) -> None:
        name = "" if fault is None else fault[0].name
        if self._changes and self._changes[-1]["status"] == name:
            return
        words = "" if fault is None else fault[1]
        self._changes.append({"unix_s": self._now(), "status": name, "words": words})
        del self._changes[:-MOST_FAULTS]
        self._is_changed = True

    def _note_drift(self, report: LinkReport) -> None:
        """Medians of the hour so far."""
        calibration = self._faults.calibration
        name = "" if calibration is None else calibration.id
        hour_s = self._now() // HOUR_S * HOUR_S
        last = self._hours[-1] if self._hours else {}
        if (last.get("unix_s"), last.get("calibration")) != (hour_s, name):
            self._samples.clear()
            self._hours.append({"unix_s": hour_s, "calibration": name})
            del self._hours[:-MOST_HOURS]
        camera = report.taught_from_camera
        # A camera that is stated to stand still is not looked for: that is no camera that stood still.
        mm, rad = (np.nan, np.nan) if camera is None else Pose.identity().distance(camera)
        misfit = report.misfit / report.freedom if report.freedom else 0.0
        self._samples.append((mm, 1e3 * rad, misfit))
        middle = [
            None if np.isnan(value) else value
            for value in np.median(self._samples, axis=0).round(4).tolist()
        ]
        self._hours[-1] |= {
            **dict(zip(("camera_mm", "camera_mrad", "misfit"), middle, strict=True)),
            "moved_mm": round(report.size_mm, 3),
            "pictures": len(self._samples),
        }
        self._is_changed = True

    def _now(self) -> float:
        return round(self._clock.wall(), 3)

    def save(self) -> None:
        """Write it, if anything is new."""
        if not self._is_changed:
            return
        self._is_changed = False
        try:
            write_document(self._path, {"hours": self._hours, "faults": self._changes}, _SCHEMA)
        except StoreError as err:
            self._is_changed = True
            if str(err) != self._trouble:
                log.warning("diary_not_written", reason=str(err))
            self._trouble = str(err)
        else:
            self._trouble = ""

    def to_json(self, days: float) -> Mapping[str, object]:
        """Hours of the last days in order; the newest fault first. lasted_s: None for one that still does."""
        ends = [one["unix_s"] for one in self._changes[1:]] + [None]
        lasted = [
            {**one, "lasted_s": None if end is None else round(end - one["unix_s"], 1)}
            for one, end in zip(self._changes, ends, strict=True)
            if one["status"]
        ]
        first_s = self._now() - days * 24 * HOUR_S
        hours = [one for one in self._hours if one["unix_s"] + HOUR_S > first_s]
        return {"hours": hours, "faults": lasted[::-1][:TOLD_FAULTS]}
