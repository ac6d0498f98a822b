"""CAD points that are not those of the object that was touched."""

import json

import numpy as np
import pytest

from tests.touch_files.test_contradictions import found, write


def change_targets(path, change):
    """The file with every target (3,) changed."""
    lines = path.read_text().splitlines()
    for i, line in enumerate(lines):
        if line.startswith("target ="):
            point = np.array(json.loads(line.removeprefix("target = ")))
            lines[i] = f"target = {change(point).tolist()}"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1e-3, "1000 times as far apart"),
        (1e-3, "in metres"),
        (1 / 25.4, "in inches"),
        (0.1, "in centimetres"),
        (1.03, "0.97"),
        (0.96, "1.04"),
    ],
)
def test_targets_in_another_unit_or_scale_are_named(tmp_path, factor, told):
    for seed in range(3):
        path = write(tmp_path, seed, kind="universal", n=12)
        message = found(change_targets(path, lambda point: factor * point))["targets_scaled"]
        assert told in message


def test_touches_rougher_than_stated_are_no_other_scale(tmp_path):
    for seed in range(12):
        told = found(write(tmp_path, seed, kind="universal", n=8 + seed % 6, noise=0.8))
        assert told.keys() <= {"touches_scatter", "touch_outlier"}


@pytest.mark.parametrize("off", [1.5, 4.0, 20.0])
def test_one_cad_point_that_is_off_is_named_with_its_place(tmp_path, off):
    for seed in range(4):
        path = write(tmp_path, seed, kind="universal", n=15)
        wrong = json.loads(path.read_text().split("target = ")[3].splitlines()[0])
        there = wrong + np.array([off, 0.0, 0.0])
        change_targets(path, lambda p, w=wrong, t=there: t if np.allclose(p, w) else p)
        message = found(path)["target_off"]
        assert f"target ({there[0]:.2f}, {there[1]:.2f}, {there[2]:.2f})" in message
        told = np.array([float(v) for v in message.split("at (")[1].split(")")[0].split(", ")])
        assert np.linalg.norm(told - wrong) < 0.6 + 0.05 * off  # one linearisation


def test_one_bad_touch_is_no_wrong_target(tmp_path):
    for bad in (0, 4, 9):
        told = found(write(tmp_path, bad, kind="universal", n=10, moved=[bad], shift=5.0))
        assert told.keys() == {"touch_outlier"}


def test_clean_touches_find_no_wrong_target(tmp_path):
    for seed in range(20):
        told = found(write(tmp_path, seed, kind="universal", n=8 + seed % 8))
        assert told.keys() <= {"touches_scatter", "touch_outlier"}
