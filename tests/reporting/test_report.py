"""The report says what the result says, proves what it was made of, and is one file that a printer takes."""

import asyncio
import hashlib
import re
from html import escape
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from tests.reporting.sessions import recorded
from vgrd.cell.control.results import Results
from vgrd.cli import app
from vgrd.devices import CameraImage
from vgrd.errors import CalibrationError, Corrupt, InputError
from vgrd.model import Plan
from vgrd.reporting import report_of, report_page
from vgrd.solving.session import solve_session
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.results import RESULT, read_result
from vgrd.store.sessions import SampleKind, SessionWriter


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> Path:
    state_dir = tmp_path_factory.mktemp("state")
    folder = recorded(state_dir)
    solve_session(folder, state_dir, tolerance_mm=2.0)
    return folder


def page_of(folder: Path) -> str:
    result = read_result(folder)
    assert result is not None
    return report_page(report_of(folder, folder.parent.parent, result))


def test_what_the_solver_told_is_kept_as_it_was_told(tmp_path):
    folder = recorded(tmp_path)
    assert read_result(folder) is None
    told = solve_session(folder, tmp_path, tolerance_mm=2.0)
    kept = read_result(folder)
    assert kept is not None
    assert kept["good"] == told["good"]
    assert kept["verification"] == told["verification"]
    assert kept["map"] == told["map"]


def test_a_result_that_was_changed_is_refused_with_the_remedy(tmp_path):
    folder = recorded(tmp_path)
    solve_session(folder, tmp_path, tolerance_mm=2.0)
    file = folder / RESULT
    file.write_text(file.read_text().replace('"ok": true', '"ok": false'))
    with pytest.raises(Corrupt, match="solve the session again"):
        read_result(folder)


def test_solving_without_a_place_for_it_keeps_nothing(tmp_path):
    folder = recorded(tmp_path)
    before = {path.name for path in folder.iterdir()}
    solve_session(folder)
    assert {path.name for path in folder.iterdir()} == before


def test_a_rejected_session_has_a_result_too(tmp_path):
    folder = recorded(tmp_path)
    solve_session(folder, tmp_path, tolerance_mm=0.01)
    assert "✖ REJECTED" in page_of(folder)
    assert CalibrationStore(tmp_path).list() == ()


def test_a_session_that_cannot_be_solved_takes_the_verdict_of_no_other(tmp_path):
    solve_session(recorded(tmp_path, "first"), tmp_path, tolerance_mm=2.0)
    folder = tmp_path / "sessions" / "second"
    few = Simulation(3).record(wrists=[WORK_ROTATION], plan=Plan.JOINT, looks=0, spins=0, points=0)
    with SessionWriter(tmp_path, "second", Plan.JOINT, few.facts, ManualClock()) as writer:
        writer.sample(SampleKind.TOUCH, few.touches[0])
    with pytest.raises(CalibrationError) as refused:
        solve_session(folder, tmp_path, tolerance_mm=2.0)
    told = asyncio.run(Results(tmp_path).table()["result"].perform({}))
    assert (told["session"], told["result"]["verdict"]["ok"]) == ("second", False)
    assert told["result"]["verdict"]["findings"][0]["message"] == str(refused.value)
    page = page_of(folder)
    assert "✖ REJECTED" in page
    assert escape(str(refused.value)) in page


def test_verdict_verification_budget_and_hashes_are_on_the_page(solved):
    page, result = page_of(solved), read_result(solved)
    for words in (
        "✔ ACCEPTED",
        "✔ GO",
        result["good"],
        result["verification"]["words"],
        "cal-000001",
    ):
        assert words in page
    for link in result["budget"]["links"]:
        assert link in page
    for name in ("session.json", "samples.jsonl", RESULT):
        assert hashlib.sha256((solved / name).read_bytes()).hexdigest() in page
    assert CalibrationStore(solved.parent.parent).read("cal-000001").sha256 in page


def test_the_page_asks_nobody_and_runs_nothing(solved):
    page = page_of(solved)
    assert "<script" not in page
    assert re.findall(r"(?:src|href|url\()\s*=?\s*[\"']?(https?:)", page) == []


def test_the_map_is_as_flat_as_its_numbers(solved):
    told = read_result(solved)["map"]
    assert len(told["angles_deg"]) == 24
    for errors in told["u95_mm"].values():
        assert len(errors) == 24
        assert min(errors) > 0
    worst = max(map(max, told["u95_mm"].values()))
    assert worst == pytest.approx(read_result(solved)["residuals"]["predicted_u95_mm"], rel=0.1)


def test_names_are_written_as_text(solved):
    result = read_result(solved)
    nasty = {**result, "good": "<script>alert(1)</script> & more"}
    page = report_page(report_of(solved, None, nasty))
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_a_picture_is_shown_where_there_is_one(tmp_path):
    sim, clock = Simulation(3), ManualClock()
    recording = sim.record(plan=Plan.JOINT)
    with SessionWriter(tmp_path, "seen", Plan.JOINT, recording.facts, clock) as writer:
        writer.image(CameraImage(np.full((30, 40), 128, np.uint8), 1.0, 1))
    result = solve_session(recorded(tmp_path), tolerance_mm=2.0)
    assert "data:image/jpeg" in report_page(report_of(writer.path, None, result))


def test_the_daemon_tells_the_newest_result_or_that_of_a_name(tmp_path):
    table = Results(tmp_path).table()

    def ask(op, **arguments):
        return asyncio.run(table[op].perform(arguments))

    assert ask("result") == {"session": None, "result": None}
    with pytest.raises(InputError, match="nothing to report"):
        ask("report")
    folder = recorded(tmp_path, "first")
    with pytest.raises(InputError, match="not solved yet"):
        ask("result", session="first")
    solve_session(folder, tmp_path, tolerance_mm=2.0)
    recorded(tmp_path, "second")
    assert ask("result")["session"] == "first"
    assert ask("report", session="first")["html"] == page_of(folder)


def run(*words: object):
    return CliRunner().invoke(app, ["report", *map(str, words)])


def test_the_command_writes_a_file(solved, tmp_path):
    out = tmp_path / "page.html"
    told = run(solved, "--out", out)
    assert told.exit_code == 0, told.output
    assert out.read_text() == page_of(solved)


def test_the_command_solves_what_was_not_solved_and_leaves_the_session_as_it_is(tmp_path):
    folder = recorded(tmp_path)
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    out = tmp_path / "page.html"
    assert run(folder, "--out", out).exit_code == 0
    assert "kept nowhere" in out.read_text() or "none was stored" in out.read_text()
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before


def test_a_place_that_cannot_be_written_is_named(solved, tmp_path):
    told = run(solved, "--out", tmp_path / "no" / "page.html")
    assert isinstance(told.exception, InputError)
    assert "page.html: cannot be written" in str(told.exception)
