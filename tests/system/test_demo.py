"""`python -m fakes demo` as a user runs it: the whole path from teaching to the robot's miss in mm."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vgrd.orphans import dying_with_us

ENDS_WITHIN_S = 1800.0  # 100 s are usual; far longer with ten times as much work as processors
pytestmark = [pytest.mark.system, pytest.mark.timeout(ENDS_WITHIN_S + 100)]

REQUESTS = 8
METHODS = ("conventional", "special", "CAD", "served")


def demo(folder: Path, *options: str) -> tuple[str, dict[str, np.ndarray]]:
    """Run the demo to its good end; what it printed, and the true misses (n, 3) mm by method."""
    command = [sys.executable, "-m", "fakes", "demo", "--folder", str(folder)]
    done = subprocess.run(
        dying_with_us([*command, "--requests", str(REQUESTS), *options]),
        capture_output=True,
        text=True,
        timeout=ENDS_WITHIN_S,
        check=False,
        env=os.environ | {"COLUMNS": "160"},
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    told = json.loads((folder / "demo.json").read_text(encoding="utf-8"))
    assert told["good"] is True
    return done.stdout, {name: np.array(misses) for name, misses in told["misses_mm"].items()}


def mean_xy_mm(misses: np.ndarray) -> float:
    return float(np.linalg.norm(misses[:, :2], axis=1).mean())


def test_the_demo_goes_the_whole_way_and_reaches_its_figures(tmp_path, record_property) -> None:
    output, misses = demo(tmp_path)
    assert "simulated robot and images; real ur-rtde and Modbus" in output
    for words in METHODS:
        assert words in output
    for fault in ("tag B covered", "TCP changed on the pendant", "cell process killed"):
        assert fault in output
    assert "MISSED" not in output
    assert misses["served"].shape == (REQUESTS, 3)
    assert mean_xy_mm(misses["served"]) <= 0.25
    record_property("served_mean_xy_mm", round(mean_xy_mm(misses["served"]), 3))

    state = tmp_path / "state"
    assert (state / "calibrations" / "cal-000001.json").is_file()
    assert (state / "calibrations" / "CURRENT").is_file()
    for session in ("teaching", "requests"):
        assert list((state / "sessions" / session).glob("*.mcap"))
        assert not list((state / "sessions" / session).glob("*.open"))
        assert str(state / "sessions" / session) in output


def test_the_paper_s_sampler_is_taught_and_asked_and_counts_bottles(tmp_path) -> None:
    """The 4-axis arm, the special method and the camera of experiment B; `fruit` is in test_modbus_robots.py."""
    output, misses = demo(tmp_path, "--cell", "sampler", "--no-faults")
    assert "insertions: a clearance of 0.4 mm" in output
    assert mean_xy_mm(misses["served"]) <= 0.2
    assert "clearance_mm = 0.4" in (tmp_path / "cell.toml").read_text(encoding="utf-8")


def test_without_noise_and_arm_errors_the_miss_is_nearly_nothing(
    tmp_path, record_property
) -> None:
    output, misses = demo(tmp_path, "--perfect", "--no-faults")
    assert mean_xy_mm(misses["served"]) <= 0.05
    assert "cell process killed" not in output
    record_property("served_mean_xy_mm", round(mean_xy_mm(misses["served"]), 3))
