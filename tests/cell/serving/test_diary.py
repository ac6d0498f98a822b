"""The diary keeps weeks, survives a restart and a bad disk, and never stops the cell."""

from types import SimpleNamespace

import numpy as np
import pytest

from fakes.testing import ManualClock
from vgrd.cell.serving.diary import FILE, HOUR_S, MOST_FAULTS, MOST_HOURS, Diary
from vgrd.geometry import Pose
from vgrd.model import LinkReport
from vgrd.registers import Status

DAYS = 90.0


class Cell:
    """What the diary looks at."""

    def __init__(self, tmp_path) -> None:
        self.clock, self.folder = ManualClock(), tmp_path
        self.fault, self.report = None, None
        self.calibration = SimpleNamespace(id="cal-000001")

    def current(self):
        return self.fault

    def diary(self) -> Diary:
        return Diary(self.folder, self, self.clock)  # type: ignore[arg-type]


@pytest.fixture
def cell(tmp_path) -> Cell:
    return Cell(tmp_path)


def shift(mm: float) -> LinkReport:
    return LinkReport(True, 6.0, Pose(np.eye(3), np.array([mm, 0.0, 0.0])), freedom=6)


def test_a_fault_is_kept_with_how_long_it_lasted(cell):
    diary = cell.diary()
    diary.look()
    for fault in ((Status.CAMERA_OFFLINE, "cable"), None, (Status.ROBOT_OFFLINE, "power")):
        cell.fault = fault
        for _ in range(3):
            diary.look()
            cell.clock.sleep(2.0)
    newest, older = diary.to_json(DAYS)["faults"]
    assert (newest["status"], newest["lasted_s"]) == ("ROBOT_OFFLINE", None)
    assert (older["status"], older["words"]) == ("CAMERA_OFFLINE", "cable")
    assert older["lasted_s"] == pytest.approx(6.0)


def test_a_camera_that_nobody_looks_for_is_not_told_to_stand_still(cell):
    diary = cell.diary()
    for _ in range(2):
        cell.report = LinkReport(False, 9000.0, None, freedom=6)
        diary.look()
    (hour,) = diary.to_json(DAYS)["hours"]
    assert (hour["camera_mm"], hour["camera_mrad"], hour["misfit"]) == (None, None, 1500.0)
    diary.save()
    again = cell.diary()
    again.load()
    assert again.to_json(DAYS)["hours"] == [hour]


def test_an_hour_is_told_by_the_median_of_its_pictures(cell):
    diary = cell.diary()
    for mm in (0.1, 0.2, 5.0):
        cell.report = shift(mm)
        diary.look()
        diary.look()  # the same picture counts once
    (hour,) = diary.to_json(DAYS)["hours"]
    assert (hour["camera_mm"], hour["pictures"], hour["misfit"]) == (0.2, 3, 1.0)


def test_another_hour_or_another_calibration_begins_anew(cell):
    diary = cell.diary()
    cell.report = shift(1.0)
    diary.look()
    cell.clock.sleep(HOUR_S)
    cell.report = shift(2.0)
    diary.look()
    cell.calibration = SimpleNamespace(id="cal-000002")
    cell.report = shift(3.0)
    diary.look()
    told = diary.to_json(DAYS)["hours"]
    assert [one["camera_mm"] for one in told] == [1.0, 2.0, 3.0]
    assert [one["calibration"] for one in told] == ["cal-000001", "cal-000001", "cal-000002"]


def test_only_the_days_that_are_asked_for_are_told(cell):
    diary = cell.diary()
    for hour in range(72):
        cell.report = shift(float(hour))
        diary.look()
        cell.clock.sleep(HOUR_S)
    assert len(diary.to_json(1.0)["hours"]) == 24
    assert len(diary.to_json(DAYS)["hours"]) == 72


def test_it_is_there_after_a_restart(cell):
    diary = cell.diary()
    cell.report, cell.fault = shift(1.0), (Status.CAMERA_OFFLINE, "cable")
    diary.look()
    diary.save()
    other = cell.diary()
    other.load()
    assert other.to_json(DAYS) == diary.to_json(DAYS)


def test_a_damaged_file_is_set_aside_and_a_new_one_begun(cell):
    (cell.folder / FILE).write_text("{")
    diary = cell.diary()
    diary.load()
    cell.report = shift(1.0)
    diary.look()
    diary.save()
    assert (cell.folder / "diary.damaged").read_text() == "{"
    other = cell.diary()
    other.load()
    assert len(other.to_json(DAYS)["hours"]) == 1


def test_a_folder_that_cannot_be_written_costs_nothing_but_the_file(cell):
    cell.folder = cell.folder / "gone"
    diary = cell.diary()
    cell.report = shift(1.0)
    diary.look()
    diary.save()
    cell.folder.mkdir()
    diary.save()
    assert (cell.folder / FILE).exists()


def test_what_did_not_change_is_not_written_again(cell):
    diary = cell.diary()
    cell.report = shift(1.0)
    diary.look()
    diary.save()
    (cell.folder / FILE).unlink()
    diary.look()
    diary.save()
    assert not (cell.folder / FILE).exists()


def test_it_does_not_grow_without_end(cell):
    diary = cell.diary()
    for i in range(MOST_HOURS + 10):
        cell.report = shift(float(i))
        cell.fault = None if i % 2 else (Status.CAMERA_OFFLINE, "cable")
        diary.look()
        cell.clock.sleep(HOUR_S)
    diary.save()
    assert (cell.folder / FILE).stat().st_size < 1e6
    assert len(diary.to_json(1e6)["hours"]) == MOST_HOURS
    assert len(diary._changes) == MOST_FAULTS
