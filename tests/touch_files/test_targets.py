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
