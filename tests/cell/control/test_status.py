"""What the status tells is of now: what was seen before the camera or the robot was lost is not."""

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.cell.control.operations import Operations
from vgrd.cell.measuring import LATE_S, Measuring, Sight
from vgrd.devices import CameraImage
from vgrd.errors import NotSteady, TooOld
from vgrd.ipc.health import HealthReporter
from vgrd.registers import Status

SEEN = ("robot_at_rest", "tag_a_seen", "tag_b_seen")
SAMPLES = Samples(1)
PICTURE = np.zeros((48, 64), np.uint8)
PERIOD_S = 0.5
HOURS_S = 7200.0


class Cell:
    """Measuring and what the status asks beside it, on a clock that a test moves."""

    def __init__(self, runtime: Path) -> None:
        self.clock = ManualClock(1000.0)
        self.camera = HealthReporter(runtime, "camera", self.clock)
        measuring: Any = Measuring(runtime, None, SAMPLES.facts(), self.clock, 1 / PERIOD_S, 10.0)  # type: ignore[arg-type]
        self.measuring = measuring
        serving = SimpleNamespace(
            fault=lambda: None,
            calibration=None,
            faults=SimpleNamespace(knock=""),
            answer=SimpleNamespace(status=Status.OK),
            vouch=SimpleNamespace(span_s=0.2),
        )
        teaching: Any = SimpleNamespace(status=dict)
        resolved: Any = SimpleNamespace(source="cell.toml", loaded_unix_s=1.0)
        parts: Any = (measuring, serving, teaching, None, runtime, runtime, self.clock, resolved)
        self._operations = Operations(None, *parts)  # type: ignore[arg-type]

    def see(self, **changes: Any) -> None:
        """A picture with both tags, of an arm at rest but for `changes`."""
        image = CameraImage(PICTURE, self.clock.monotonic(), 1)
        seen = SAMPLES.observation()
        tags = {"tag_a": SAMPLES.tag(seen.tag_b.tag), "tag_b": seen.tag_b}
        pose = {"base_from_wrist": SAMPLES.pose(), "unpaired": None}
        self.measuring.sight = Sight(image=image, **{**tags, **pose, **changes})
        self.camera.report("ok")

    def told(self) -> dict[str, Any]:
        return dict(asyncio.run(self._operations.table()["status"].perform({})))


@pytest.fixture
def cell(tmp_path: Path) -> Cell:
    return Cell(tmp_path)


def seen(cell: Cell) -> tuple[Any, ...]:
    told = cell.told()
    return tuple(told[name] for name in SEEN)


def test_what_the_newest_picture_shows_is_told(cell: Cell) -> None:
    cell.see()
    assert seen(cell) == (True, True, True)
    assert cell.told()["tags"]["b"]["side_px"] > 0
    cell.see(tag_a=None, base_from_wrist=None, unpaired=NotSteady("it moved"))
    assert seen(cell) == (False, False, True)


def test_before_the_first_picture_nothing_is_known(cell: Cell) -> None:
    cell.camera.report("ok")
    assert seen(cell) == (None, None, None)
    assert cell.told()["picture_age_s"] is None


def _vanish(cell: Cell) -> None:
    cell.clock.sleep(HOURS_S)


def _say_so(cell: Cell) -> None:
    cell.camera.report("unavailable", "no answer")


def _hang(cell: Cell) -> None:
    """The process is well, and no picture comes."""
    cell.clock.sleep(PERIOD_S + LATE_S + 0.1)
    cell.camera.report("ok")


def _refuse(cell: Cell) -> None:
    cell.measuring._unusable = "of another size"


@pytest.mark.parametrize("lose", [_vanish, _say_so, _hang, _refuse])
def test_what_a_lost_camera_saw_last_is_not_told_as_of_now(cell: Cell, lose: Any) -> None:
    cell.see()
    stamp_s = cell.clock.monotonic()
    lose(cell)
    assert seen(cell) == (None, None, None)
    told = cell.told()
    assert all(tag["side_px"] is None for tag in told["tags"].values())
    assert told["picture_age_s"] == pytest.approx(cell.clock.monotonic() - stamp_s, abs=1e-3)
    cell.measuring._unusable = ""
    cell.see()
    assert seen(cell) == (True, True, True)


def test_a_picture_is_of_now_until_the_next_one_is_overdue(cell: Cell) -> None:
    cell.see()
    cell.clock.sleep(PERIOD_S + LATE_S - 0.1)
    cell.camera.report("ok")
    assert seen(cell) == (True, True, True)


def test_whether_a_silent_robot_moves_is_not_told(cell: Cell) -> None:
    cell.see(base_from_wrist=None, unpaired=TooOld("no reading"))
    assert seen(cell) == (None, True, True)
