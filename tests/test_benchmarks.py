"""The benchmarks run, print a table and leave their figures; what they measure is not judged here."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.benchmarks.__main__ import cells_of
from tests.benchmarks.harness import Row
from tests.benchmarks.serving.clients import Missing, built
from vgrd.orphans import dying_with_us

ROOT = Path(__file__).parents[1]
GOOD = """
from tests.benchmarks.harness import Row
def rows():
    yield Row.at_least("{name}_first", 2.0, "x", 1.0)
    {then}
    yield Row.at_least("{name}_second", 2.0, "x", 1.0)
"""
PEER = """
import multiprocessing
import numpy as np
from tests.benchmarks.harness import Row
from tests.benchmarks.peers import Peer, PeerLost
def rows():
    with Peer("OpenCV", refinement="NONE") as peer:
        for child in multiprocessing.active_children():
            child.kill()
        try:
            peer.corners(np.zeros((50, 50), np.uint8))
        except PeerLost as lost:
            yield Row.failed("crashed", str(lost))
    with Peer("OpenCV", refinement="NONE") as peer:
        yield Row.at_most("tags", peer.keep(np.zeros((50, 50), np.uint8)), "", 0)
"""
CRASHES = "import os; os.abort()"
RAISES = "raise ZeroDivisionError('by nothing')"
WAITS = "import time; time.sleep(987654)"
HANGS = "import subprocess, time; subprocess.Popen(['sleep', '987654']); time.sleep(987654)"


def benchmarks(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.benchmarks", *map(str, arguments)]
    return subprocess.run(
        dying_with_us(command),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"COLUMNS": "150"},
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, then in (
        ("abort", CRASHES),
        ("good", "pass"),
        ("hang", HANGS),
        ("raise", RAISES),
        ("wait", WAITS),
    ):
        text = GOOD.format(name=name, then=then)
        (tmp_path / f"bench_{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_benchmark_leaves_its_figures(tmp_path: Path) -> None:
    result = tmp_path / "bench.json"
    done = benchmarks("ring", "--result", result)
    assert done.returncode in (0, 1), done.stderr
    assert "ring_image_vs_memcpy" in done.stdout
    rows = json.loads(result.read_text(encoding="utf-8"))
    assert [set(row) for row in rows] == [{"name", "value", "unit", "bar", "ok"}]


def test_a_module_that_crashes_raises_or_hangs_costs_its_own_rows_only(folder: Path) -> None:
    result = folder / "bench.json"
    names = ("abort", "good", "hang", "raise")
    done = benchmarks(*names, "--folder", folder, "--result", result, "--timeout-s", 8)
    assert done.returncode == 1
    rows = json.loads(result.read_text(encoding="utf-8"))
    assert [(row["name"], row["ok"]) for row in rows] == [
        ("abort_first", True),
        ("bench_abort", False),
        ("good_first", True),
        ("good_second", True),
        ("hang_first", True),
        ("bench_hang", False),
        ("raise_first", True),
        ("bench_raise", False),
    ]
    told = {row["name"]: row.get("failure") for row in rows}
    assert told["bench_abort"] == "ended by SIGABRT"
    assert told["bench_hang"] == "silent for 8 s"
    assert told["bench_raise"] == "ZeroDivisionError: by nothing"
    for words in ("ended by SIGABRT", "silent for 8 s", "by nothing", "FAILED"):
        assert words in done.stdout
    assert "Traceback" in done.stderr  # where to look
    assert not processes_called("987654")


def processes_called(words: str) -> list[str]:
    return [text for path in Path("/proc").glob("[0-9]*/cmdline") if words in (text := read(path))]


def read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def test_rows_are_shown_and_kept_while_the_next_ones_are_measured(folder: Path) -> None:
    result = folder / "bench.json"
    command = [sys.executable, "-m", "tests.benchmarks", "wait", "--folder", str(folder)]
    with subprocess.Popen(
        dying_with_us([*command, "--result", str(result)]),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == "bench_wait ..."
        assert "wait_first" in process.stdout.readline()
        process.kill()
    assert [row["name"] for row in json.loads(result.read_text(encoding="utf-8"))] == [
        "wait_first"
    ]
    end_s = time.monotonic() + 20.0
    while processes_called("bench_wait") and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not processes_called("bench_wait")


def test_a_peer_that_crashes_costs_its_own_figure_only(folder: Path) -> None:
    (folder / "bench_peer.py").write_text(PEER, encoding="utf-8")
    result = folder / "bench.json"
    done = benchmarks("peer", "--folder", folder, "--result", result)
    assert done.returncode == 1
    first, second = json.loads(result.read_text(encoding="utf-8"))
    assert first["failure"] == "OpenCV ended by SIGKILL"
    assert (second["name"], second["ok"]) == ("tags", True)


def test_names_choose_modules_and_an_unknown_one_is_told(folder: Path) -> None:
    result = folder / "bench.json"
    done = benchmarks("good", "--folder", folder, "--result", result)
    assert done.returncode == 0, done.stderr
    assert [row["name"] for row in json.loads(result.read_text())] == ["good_first", "good_second"]
    done = benchmarks("nonsense", "--folder", folder, "--result", result)
    assert done.returncode == 2
    assert "no benchmark is called nonsense" in done.stdout


def test_pictures_that_no_camera_should_send_do_not_upset_the_tag_finders() -> None:
    command = [sys.executable, "-X", "faulthandler", "-W", "error"]
    done = subprocess.run(
        dying_with_us([*command, "-m", "tests.benchmarks.hostile_pictures", "200"]),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"picture {done.stdout.split()[-1:]}: {done.stderr[-2000:]}"
    assert done.stdout.split() == [str(number) for number in range(200)]


def test_a_row_that_needs_what_is_not_there_is_skipped_with_the_reason() -> None:
    row = Row(**Row.skipped("figure", "no libmodbus").as_message())
    assert row.ok
    assert cells_of(row) == ("figure", "", "", "", "skipped", "no libmodbus")
    assert row.as_json() == {"name": "figure", "value": None, "ok": True, "skip": "no libmodbus"}


def test_a_program_in_c_that_cannot_be_made_is_missing_and_not_an_error() -> None:
    with pytest.raises(Missing, match=r"libmodbus_server\.c was not compiled"):
        built("libmodbus_server", "-lnosuchlibrary")
