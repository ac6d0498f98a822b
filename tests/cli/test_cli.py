"""The command line without a daemon: what it prints, what it refuses and how, and that files stay whole."""

import json
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.cell.cell import cell_text
from fakes.cell.rehearsal import NO_CAMERA, NO_ROBOT
from fakes.world.layout import Layout
from fakes.world.noise import Vision
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.clock import SystemClock
from vgrd.model import Plan, Recording
from vgrd.orphans import dying_with_us
from vgrd.store.sessions import SampleKind, SessionWriter

SEED = 4
STEADY = Vision(0.001, 0.02, 0.005, 0.005)
TILT_RAD = 0.44


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    return write_cell(tmp_path, 1502)


def write_cell(folder: Path, port: int) -> Path:
    path = folder / "cell.toml"
    text = cell_text(Layout(), robot=NO_ROBOT, camera=NO_CAMERA, port=port)
    path.write_text(text, encoding="utf-8")
    return path


def write_session(state: Path, recording: Recording) -> Path:
    """A finished session with these samples."""
    clock = SystemClock()
    writer = SessionWriter(state, recording.session, recording.plan, recording.facts, clock)
    with writer:
        for kind, values in (
            (SampleKind.LOOK, recording.looks),
            (SampleKind.SPIN, recording.spins),
            (SampleKind.TOUCH, recording.touches),
            (SampleKind.POINT, recording.points),
            (SampleKind.VERIFY, recording.verifications),
        ):
            for value in values:
                writer.sample(kind, value)
    return writer.path


def test_a_good_cell_file_is_told_with_what_it_holds(vgrd, cell_file) -> None:
    result = vgrd("check", cell_file, "--json", "-").result
    assert result["ok"] is True
    assert result["registers"] == "127.0.0.1:1502"
    assert result["targets"] == [f"P{k}" for k in range(1, 7)]
    assert "fake-cell" in vgrd("check", cell_file).out


def test_all_faults_of_a_cell_file_are_told_at_once(vgrd, cell_file) -> None:
    text = cell_file.read_text(encoding="utf-8")
    for old, new in (
        ("rate_hz", "rate_hertz"),
        ("lateral_sigma_mm = 0.233", "lateral_sigma_m = 0.000233"),
        ("[serving]", "[servings]"),
        ('motion = "turntable"', 'motion = "turntabel"'),
        (f"port = {1502}", "port = 99999"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    cell_file.write_text(text, encoding="utf-8")
    done = vgrd("check", cell_file)
    assert done.code == 78
    for words in (
        str(cell_file),
        "camera.rate_hertz: unknown key, did you mean 'rate_hz'?",
        "touch.lateral_sigma_m: unknown key, did you mean 'lateral_sigma_mm'?",
        "servings: unknown key, did you mean 'serving'?",
        "object.motion",
    ):
        assert words in done.err
    assert done.out == ""


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_missing_cell_file_is_named_with_the_remedy(vgrd, tmp_path, command) -> None:
    done = vgrd(command, tmp_path / "nowhere.toml")
    assert done.code == 78
    assert "nowhere.toml" in done.err
    assert "no such file" in done.err


def test_json_goes_to_a_file_beside_the_table(vgrd, cell_file, tmp_path) -> None:
    done = vgrd("check", cell_file, "--json", tmp_path / "out.json")
    assert done.code == 0
    assert json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["ok"] is True
    assert "fake-cell" in done.out


@pytest.mark.parametrize("place", ["missing/out.json", "."])
def test_a_place_where_json_cannot_be_written_is_refused_before_the_work(
    vgrd, cell_file, tmp_path, place
) -> None:
    done = vgrd("check", cell_file, "--json", f"{tmp_path}/{place}")
    assert done.code == 65
    assert f"--json {tmp_path}/{place}" in done.err
    assert done.out == ""


def test_without_a_daemon_each_question_says_how_to_start_one(vgrd, cell_file) -> None:
    for words in (
        ("status",),
        ("look",),
        ("touch", "P1"),
        ("undo",),
        ("record", "start"),
        ("solve",),
        ("activate", "cal-000001"),
        ("ec", "P1"),
    ):
        done = vgrd(*words, "--config", cell_file, "--json", "-")
        assert done.code == 69, words
        assert "control.sock" in done.err
        assert "vgrd run" in done.err
        assert done.out == ""


def test_a_question_to_no_daemon_in_particular_is_refused(vgrd, monkeypatch) -> None:
    monkeypatch.delenv("VGRD_CONFIG", raising=False)
    monkeypatch.delenv("VGRD_SOCKET", raising=False)
    done = vgrd("status")
    assert done.code == 65
    assert "--config" in done.err


def test_a_recorded_session_is_solved_without_a_daemon(vgrd, tmp_path) -> None:
    cell = Simulation(SEED, vision=STEADY, touch_sigma_mm=0.05)
    wrists = [cell.wrist(TILT_RAD) for _ in range(12)]
    folder = write_session(tmp_path / "state", cell.record(plan=Plan.SPECIAL, wrists=wrists))
    result = vgrd("solve", folder, "--json", "-").result
    assert result["verdict"]["ok"] is True
    assert np.linalg.norm(np.array(result["tcp_in_wrist_mm"]) - cell.tcp_in_wrist) < 0.5
    assert result["warnings"] == []
    assert "universal" in vgrd("solve", folder).out
    assert not (tmp_path / "state" / "calibrations").exists()


def test_solve_says_what_one_picture_cannot_tell_of_this_cell(vgrd, tmp_path, cell_file) -> None:
    cell = Simulation(SEED)
    wrists = [cell.wrist(TILT_RAD * (i > 5)) for i in range(10)]
    folder = write_session(tmp_path / "state", cell.record(plan=Plan.JOINT, wrists=wrists))
    movable = tmp_path / "movable.toml"
    text = cell_file.read_text(encoding="utf-8")
    movable.write_text(
        text.replace("[camera]\n", '[camera]\nstability = "movable"\n'), encoding="utf-8"
    )
    told = " ".join(vgrd("solve", folder, "--config", cell_file).out.split())
    assert "cannot tell a slip of tag B along the arc about the axis: a second tag" in told
    assert "A slip of tag A that way passes for a knock of the camera" in told
    result = vgrd("solve", folder, "--config", movable, "--json", "-").result
    assert "A slip of tag A that way is not told either" in result["blind_spots"][1]
    assert "add --config" in vgrd("solve", folder).out


def test_a_session_that_a_kill_cut_short_in_a_line_is_solved_with_what_is_whole(
    vgrd, tmp_path
) -> None:
    cell = Simulation(SEED, vision=STEADY, touch_sigma_mm=0.05)
    wrists = [cell.wrist(TILT_RAD) for _ in range(12)]
    folder = write_session(tmp_path / "state", cell.record(plan=Plan.SPECIAL, wrists=wrists))
    samples = folder / "samples.jsonl"
    whole = samples.read_bytes()
    samples.write_bytes(whole[:-100])
    (folder / "closed.json").unlink()  # a kill leaves none
    result = vgrd("solve", folder, "--json", "-").result
    assert result["verdict"]["ok"] is True
    assert len(result["warnings"]) == 1
    assert samples.read_bytes() == whole[:-100]


def test_a_session_with_too_few_samples_is_refused_with_the_reason(vgrd, tmp_path) -> None:
    cell = Simulation(SEED, vision=STEADY)
    folder = write_session(tmp_path / "state", cell.record(plan=Plan.SPECIAL, looks=1, spins=0))
    done = vgrd("solve", folder, "--json", "-")
    assert done.code == 65
    assert "determine 11 of 12 unknowns" in done.err
    assert "turn it" in done.err


def test_a_rejected_calibration_is_told_with_its_reason_and_by_the_exit_code(
    vgrd, tmp_path
) -> None:
    cell = Simulation(SEED, vision=STEADY)
    elsewhere = replace(cell.touch("P1", WORK_ROTATION), target="P2")
    recording = cell.record(plan=Plan.SPECIAL, wrists=[cell.wrist(TILT_RAD) for _ in range(12)])
    folder = write_session(tmp_path / "state", replace(recording, verifications=(elsewhere,)))
    done = vgrd("solve", folder, "--json", "-")
    assert done.code == 65
    (finding,) = (f for f in json.loads(done.out)["verdict"]["findings"] if f["fatal"])
    assert finding["code"] == "verification_failed"
    assert "touch the targets again" in finding["message"]


def test_a_session_whose_samples_were_damaged_is_refused_with_file_and_line(
    vgrd, tmp_path
) -> None:
    cell = Simulation(SEED, vision=STEADY)
    folder = write_session(tmp_path / "state", cell.record(plan=Plan.SPECIAL))
    samples = folder / "samples.jsonl"
    damaged = bytearray(samples.read_bytes())
    damaged[len(damaged) // 3] ^= 1
    samples.write_bytes(damaged)
    done = vgrd("solve", folder)
    assert done.code == 74
    assert f"{samples}, line" in done.err


def test_a_folder_that_is_no_session_is_refused(vgrd, tmp_path) -> None:
    done = vgrd("solve", tmp_path)
    assert done.code == 74
    assert "is not a session" in done.err


def test_options_of_sessions_are_refused_for_datasets_and_the_daemon(vgrd, tmp_path) -> None:
    for words in ((), (tmp_path / "some.toml",)):
        done = vgrd("solve", *words, "--draw", "drawn")
        assert done.code == 65
        assert "--draw is for recorded sessions: name a SESSION_FOLDER" in done.err
    assert not (tmp_path / "drawn").exists()
    done = vgrd("solve", "--tolerance-mm", "0.3")  # the daemon has max_u95_mm of its cell
    assert done.code == 65
    assert "--tolerance-mm: name a SESSION_FOLDER or a DATASET.toml" in done.err


def test_a_missing_dataset_is_named(vgrd, tmp_path) -> None:
    done = vgrd("solve", tmp_path / "nowhere.toml", "--json", tmp_path / "out.json")
    assert done.code in (65, 78)
    assert "nowhere.toml" in done.err
    assert "no such file" in done.err
    assert not (tmp_path / "out.json").exists()


def test_an_invalid_dataset_is_refused_and_an_earlier_result_stays(vgrd, tmp_path) -> None:
    (tmp_path / "bad.toml").write_text('mount = "eye-to-hands"\n', encoding="utf-8")
    (tmp_path / "out.json").write_text("earlier", encoding="utf-8")
    done = vgrd("solve", tmp_path / "bad.toml", "--json", tmp_path / "out.json")
    assert done.code in (65, 78)
    assert "did you mean 'eye-to-hand'" in done.err
    assert (tmp_path / "out.json").read_text(encoding="utf-8") == "earlier"


def test_a_taken_port_ends_the_start_with_host_port_and_remedy(tmp_path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run(
            dying_with_us(
                [sys.executable, "-m", "vgrd.cli", "run", str(write_cell(tmp_path, port))]
            ),
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
    assert done.returncode == 69
    assert f"127.0.0.1:{port}" in done.stderr
    assert "[serving] port" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_folder_that_cannot_be_made_is_named_with_the_key(vgrd, cell_file) -> None:
    (cell_file.parent / "run").write_text("a file in its place", encoding="utf-8")
    done = vgrd("run", cell_file)
    assert done.code == 65
    assert "runtime_dir" in done.err
