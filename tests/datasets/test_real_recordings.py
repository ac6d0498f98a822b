"""Recordings that others published; skipped where they are not beside the checkout."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vgrd.solving.datasets import solve_dataset

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
CONVERTER = ROOT / "config" / "examples" / "convert_ros_industrial.py"


def converted(name, folder, *options):
    """DATASET.toml of a published recording."""
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is not there: it is no part of the repository")
    command = [sys.executable, str(CONVERTER), str(DATA / name), str(folder), *options]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "dataset.toml"


def solved(path):
    result = json.loads(json.dumps(solve_dataset(path).to_json(), allow_nan=False))
    by_name = {sample["name"]: sample for sample in result["samples"]}
    return result, by_name


def check_named(result, samples):
    """Pictures 2 and 15 are named with the reason; all others speak for themselves."""
    assert [name for name, sample in samples.items() if not sample["used"]] == ["2"]
    assert "of 24 corners" in samples["2"]["reason"]
    assert "of 24 points seen" in samples["15"]["reason"]
    assert "off the fit of the others" in samples["15"]["reason"]
    messages = [finding["message"] for finding in result["verdict"]["findings"]]
    for name in ("sample 2:", "sample 15:"):
        assert any(message.startswith(name) for message in messages)
    seen = [sample["mm"] for sample in samples.values() if sample["mm"] is not None]
    assert len(seen) == 15
    assert result["leave_one_out"]["mm"] == pytest.approx(np.mean(seen))


def test_intrinsics_that_do_not_fit_beyond_doubt_are_refined_and_that_is_said(tmp_path):
    result, samples = solved(converted("ros-industrial-charuco", tmp_path))
    assert result["leave_one_out"]["deg"] <= 0.270
    assert result["leave_one_out"]["mm"] <= 2.85
    assert result["intrinsics"]["refined"]
    check_named(result, samples)
    assert "intrinsics_doubtful" in {f["code"] for f in result["verdict"]["findings"]}
    given = result["as_given"]
    assert given["base_from_camera"] != result["base_from_camera"]
    assert result["leave_one_out"]["px"] < given["leave_one_out"]["px"]
    assert given["leave_one_out"]["mm"] < 9.3  # Park-Martin's, README of the data: 9.49
    assert given["leave_one_out"]["deg"] < 1.3


def test_with_refined_intrinsics_it_is_better_than_the_baseline(tmp_path):
    result, samples = solved(converted("ros-industrial-charuco", tmp_path, "--refine"))
    assert result["leave_one_out"]["deg"] <= 0.270
    assert result["leave_one_out"]["mm"] <= 2.85
    check_named(result, samples)


def test_the_pairs_of_moveit_give_what_its_own_test_expects(tmp_path):
    result, _ = solved(converted("moveit-pairs", tmp_path))
    camera_in_base = np.array(result["base_from_camera"])[:3, 3]
    assert camera_in_base == pytest.approx([659, -249, 830], rel=0.01)
    assert result["verdict"]["ok"] is None
    assert 4.8 < result["quality"]["within_mm"] < 12
