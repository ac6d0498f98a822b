"""From a cell file that leaves out point_mm to the coordinate that a robot reads; no process, no device."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.world.simulation import WORK_ROTATION, Simulation
from tests.cell.serving.bench import CALIBRATION_ID, LIMITS, request
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import answer_request, check_request
from vgrd.clock import SystemClock
from vgrd.config.cell_file import load_config
from vgrd.config.setup import cell_facts
from vgrd.devices import CameraImage
from vgrd.errors import CalibrationMismatch
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Plan, Policy
from vgrd.registers import Status
from vgrd.solving.advisor import advise_folder
from vgrd.solving.servable import check_usable, places_without_cad
from vgrd.solving.session import solve_session
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import SampleKind, SessionWriter

CELL = """
[cell]
name = "parts"
[robot]
driver = "ur_rtde"
sigma_mm = 0.001
[camera]
driver = "aravis"
matrix = [6486.0, 6486.0, 2012.0, 1518.0]
size_px = [4024, 3036]
[tags.a]
id = 0
size_mm = 25.0
size_sigma_mm = 0
[tags.b]
id = 1
size_mm = 25.0
size_sigma_mm = 0
[object]
motion = "turntable"
center_mm = [0, 0, 0]
"""
BARE = ("P5", "P6")


def cell_file(folder: Path, cell: Simulation) -> CellFacts:
    """What a cell file with four targets in CAD, one that is touched and one that is not says."""
    text = CELL
    for target in cell.targets.values():
        text += f'[[object.targets]]\nid = {target.id}\nname = "{target.name}"\n'
        if target.name not in BARE:
            text += f"point_mm = {target.cad.tolist()}\n"
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return cell_facts(load_config(path))


def recorded(folder: Path, cell: Simulation, facts: CellFacts) -> Path:
    touched = ("P1", "P2", "P3", "P4", "P5", "P1", "P2", "P3", "P4")
    wrists = [WORK_ROTATION] * 5 + [cell.wrist(np.radians(25)) for _ in range(4)]
    recording = cell.record(wrists=wrists, names=touched)
    with SessionWriter(folder, "s", Plan.JOINT, facts, SystemClock()) as writer:
        for kind, values in (
            (SampleKind.LOOK, recording.looks),
            (SampleKind.SPIN, recording.spins),
            (SampleKind.TOUCH, recording.touches),
        ):
            for value in values:
                writer.sample(kind, value)
    return writer.path


def test_a_target_without_cad_is_taught_stored_printed_and_served(tmp_path: Path) -> None:
    cell = Simulation(21)
    facts = cell_file(tmp_path, cell)
    assert facts.object.bare == BARE
    folder = recorded(tmp_path, cell, facts)
    advice = advise_folder(folder, Policy.FIXED)
    assert str(advice["next"]).count("touch P6") == 1
    told = solve_session(folder, tmp_path, policy=Policy.FIXED)
    assert told["verdict"]["ok"]
    assert "P6 has no point_mm and was not touched" in str(told["verdict"])
    calibration = CalibrationStore(tmp_path).load(told["calibration"])
    check_usable(calibration, facts)

    assert told["without_cad"] == places_without_cad(calibration)
    assert list(told["without_cad"]) == ["P5"]
    placed = told["without_cad"]["P5"]
    true = cell.object_from_tag_b.inverse() @ cell.targets["P5"].cad
    sigmas = np.abs(np.array(placed["in_tag_b_mm"]) - true) / placed["sigma_mm"]
    assert sigmas.max() < 4
    assert 0.05 < min(placed["sigma_mm"]) < max(placed["sigma_mm"]) < 2

    angle = 1.1
    seen = cell.observe(cell.standing, angle)
    image = CameraImage(np.zeros((2, 2), np.uint8), 1000.0, 1)
    sight = Sight(image, seen.tag_a, seen.tag_b, seen.base_from_wrist, None, seen.rest_since_s)
    asked = request(POINT=5)
    assert check_request(asked, calibration) is None
    limits = replace(LIMITS, max_u95_mm=3.0, warn_u95_mm=3.0)
    answer, expected = answer_request(
        asked, calibration, CALIBRATION_ID, sight, limits, 1000.5, 1.7e9
    )
    assert answer.status is Status.OK
    pose = Pose.from_rotvec(answer.rotation, np.array(answer.position_um) / 1000)
    miss_mm = float(np.linalg.norm(pose @ cell.tcp_in_wrist - cell.point("P5", angle)))
    assert expected is not None
    assert miss_mm < 1.5 * expected.u95_mm
    refused = check_request(request(POINT=6), calibration)
    assert refused is not None
    assert (refused.status, refused.detail) == (Status.UNKNOWN_POINT, 6)


def test_cad_that_is_added_later_is_another_fact(tmp_path: Path) -> None:
    cell = Simulation(22)
    facts = cell_file(tmp_path, cell)
    told = solve_session(recorded(tmp_path, cell, facts), tmp_path, policy=Policy.FIXED)
    calibration = CalibrationStore(tmp_path).load(told["calibration"])
    spec = facts.object
    targets = {**spec.targets, "P5": replace(spec.targets["P5"], point_in_object=np.zeros(3))}
    changed = replace(facts, object=replace(spec, targets=targets))
    with pytest.raises(
        CalibrationMismatch, match=r"object\.targets\.P5\.point_mm was none, is \[0"
    ):
        check_usable(calibration, changed)
