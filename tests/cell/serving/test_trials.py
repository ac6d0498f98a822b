"""Verifications of the calibration in use: judged by what is served, kept, counted by the object's turns."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from tests.reporting.sessions import TURNED, recorded
from vgrd.cell.serving.trials import Trials
from vgrd.errors import ControlError, Corrupt, InputError
from vgrd.geometry import Pose
from vgrd.solving.session import solve_session
from vgrd.store.calibrations import CalibrationStore


@pytest.fixture
def cell(tmp_path) -> Any:
    solve_session(recorded(tmp_path), tmp_path, tolerance_mm=2.0)
    calibration = CalibrationStore(tmp_path, ManualClock()).load("cal-000001")
    serving = SimpleNamespace(
        calibration=calibration,
        calibration_id=7,
        cameras=SimpleNamespace(stability=None),
        limits=SimpleNamespace(max_u95_mm=2.0),
    )
    return SimpleNamespace(folder=tmp_path, serving=serving, sim=Simulation(3))


def trials(cell: Any) -> Trials:
    return Trials(cell.serving, cell.folder, ManualClock())


def add(cell: Any, angle: float, off_mm: float = 0.0) -> dict[str, Any]:
    touch = cell.sim.touch("P2", WORK_ROTATION, angle)
    pose = touch.base_from_wrist
    moved = Pose(pose.rotation, pose.translation + np.array([off_mm, 0.0, 0.0]))
    return asyncio.run(trials(cell).add(replace(touch, base_from_wrist=moved)))


def test_two_turns_are_go_and_the_taught_turn_counts_for_nothing(cell):
    assert asyncio.run(trials(cell).tell())["verdict"] == "open"
    assert add(cell, 0.0)["verdict"] == "open"
    assert add(cell, TURNED[0])["verdict"] == "open"
    told = add(cell, TURNED[1])
    assert told["verdict"] == "go"
    assert [one["counts"] for one in told["verifications"]] == [False, True, True]
    assert told["confirmed_mm"] > 0


def test_one_that_is_off_is_no_go_and_stays_so(cell):
    for angle in TURNED:
        add(cell, angle)
    assert add(cell, 4.5, off_mm=8.0)["verdict"] == "no go"
    assert add(cell, -0.9)["verdict"] == "no go"


def test_they_are_kept_by_calibration_over_a_restart(cell):
    add(cell, TURNED[0])
    before = asyncio.run(trials(cell).tell())
    assert asyncio.run(trials(cell).tell()) == before
    cell.serving.calibration = replace(cell.serving.calibration, id="cal-000002")
    assert asyncio.run(trials(cell).tell())["verifications"] == []


def test_what_vouched_for_another_calibration_of_this_name_vouches_for_none_of_this(cell):
    for angle in TURNED:
        add(cell, angle)
    cell.serving.calibration_id = 8  # a restore brought another cal-000001
    assert asyncio.run(trials(cell).tell())["verifications"] == []
    with pytest.raises(InputError, match="nothing undone"):
        asyncio.run(trials(cell).undo())
    assert add(cell, TURNED[0])["verdict"] == "open"
    cell.serving.calibration_id = 7
    assert asyncio.run(trials(cell).tell())["verdict"] == "go"


def test_of_many_at_once_each_is_kept(cell):
    kept = trials(cell)

    async def verify() -> None:
        touches = [cell.sim.touch("P2", WORK_ROTATION, angle) for angle in (1, 2, 3, 4, 5)]
        await asyncio.gather(*(kept.add(touch) for touch in touches))

    asyncio.run(verify())
    assert len(asyncio.run(trials(cell).tell())["verifications"]) == 5
    assert kept.changes == 5


def test_without_the_session_they_are_compared_among_themselves(cell):
    cell.serving.calibration = replace(cell.serving.calibration, session="gone")
    assert add(cell, 0.0)["verifications"][0]["counts"]
    assert not add(cell, 0.1)["verifications"][1]["counts"]


def test_without_a_calibration_there_is_nothing_to_verify(cell):
    cell.serving.calibration = None
    with pytest.raises(ControlError, match="nothing to verify"):
        asyncio.run(trials(cell).tell())


def test_a_damaged_file_is_named_and_nothing_overwrites_it(cell):
    add(cell, TURNED[0])
    file = cell.folder / "trials" / "cal-000001.json"
    file.write_text(file.read_text().replace("P2", "P3"))
    damaged = file.read_text()
    with pytest.raises(Corrupt, match="move it away"):
        add(cell, TURNED[1])
    assert file.read_text() == damaged


def test_the_last_one_is_taken_back_and_stays_in_the_file(cell):
    add(cell, TURNED[0])
    assert add(cell, TURNED[1], off_mm=8.0)["verdict"] == "no go"
    told = asyncio.run(trials(cell).undo())
    assert told["verdict"] == "open"
    assert len(told["verifications"]) == 1
    assert (cell.folder / "trials" / "cal-000001.json").read_text().count('"target"') == 2
    asyncio.run(trials(cell).undo())
    with pytest.raises(InputError, match="nothing undone"):
        asyncio.run(trials(cell).undo())
