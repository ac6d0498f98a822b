"""Repeated touches of one target tell the operator's repeatability, which weighs the touches."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([12.0, -7.0, 148.0])
FORMAT = RotationFormat.RPY_FIXED_XYZ_DEG
NOISE_MM = np.array([0.4, 0.4, 0.1])


def write(folder, *, kind="universal", targets=4, times=4, seed=1, sigma="", same_wrist=False):
    """`times` touches of each target; noise 0.4 mm across and 0.1 mm along the tool."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-90, 90, (targets, 3)) * (kind == "universal")
    lines = [f'kind = "{kind}"', "[poses]", 'unit = "mm"', f'rotation = "{FORMAT}"']
    down = Rotation.from_rotvec([np.pi, 0, 0])
    for k, point in enumerate(points):
        tilts = rng.uniform(-0.6, 0.6, (times, 3))
        tilts = tilts[:1].repeat(times, axis=0) if same_wrist else tilts
        for i, tilt in enumerate(tilts):
            R = (down * Rotation.from_rotvec(tilt)).as_matrix()
            at = point + np.array((400.0, 100.0, 60.0)) - R @ (TCP + rng.normal(size=3) * NOISE_MM)
            pose = [float(v) for v in (*at, *rotation_to(R, FORMAT))]
            lines += ["[[touch]]", f'name = "p{k}.{i}"', f"pose = {pose}", sigma]
            lines += [f"target = {point.tolist()}"] if kind == "universal" else []
    path = folder / "touches.toml"
    path.write_text("\n".join(lines))
    return path


def told(path):
    return json.loads(json.dumps(solve_touches(path).to_json(), allow_nan=False))


@pytest.mark.parametrize(
    ("kind", "targets", "times", "same_wrist", "along_at_most"),
    [
        ("universal", 5, 4, True, 0.12),
        # With other wrists the others' errors across the tool tell on each one's along it.
        ("universal", 5, 4, False, 0.2),
        ("fixed-point", 1, 10, False, 0.2),
    ],
)
def test_the_operators_sigma_is_found_across_and_along_the_tool(
    tmp_path, kind, targets, times, same_wrist, along_at_most
):
    values, inside = [], 0
    for seed in range(30):
        options = {"kind": kind, "targets": targets, "times": times, "same_wrist": same_wrist}
        result = told(write(tmp_path, seed=seed, **options))["repeatability_mm"]
        lateral = result["lateral"]
        values.append((lateral["sigma"], result["axial"]["sigma"]))
        inside += lateral["low"] < 0.4 < lateral["high"]
    across, along = np.sqrt(np.mean(np.square(values), axis=0))
    assert across == pytest.approx(0.4, rel=0.12)
    assert 0.08 < along < along_at_most
    assert inside >= 24


def test_it_weighs_the_touches_that_gave_no_sigma_so_that_no_alarm_is_left(tmp_path):
    path = write(tmp_path)
    result = told(path)
    assert result["repeatability_mm"]["applied"]
    assert result["verdict"]["findings"] == []
    given = told(write(tmp_path, sigma="sigma_mm = [0.4, 0.1]"))
    assert not given["repeatability_mm"]["applied"]
    np.testing.assert_allclose(result["tcp_in_wrist"], given["tcp_in_wrist"], atol=0.1)
    sizes = [np.sqrt(np.trace(one["covariance"])) for one in (result, given)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.35)


def test_the_weights_make_the_tcp_better_than_equal_ones(tmp_path):
    squares = []
    for sigma in ("", "sigma_mm = [0.233, 0.233]"):
        off = [
            np.subtract(told(write(tmp_path, seed=s, sigma=sigma))["tcp_in_wrist"], TCP)
            for s in range(25)
        ]
        squares.append(np.mean(np.square(off)))
    assert squares[0] < 0.9 * squares[1]


def test_few_repeats_are_told_but_not_relied_on(tmp_path):
    path = write(tmp_path, targets=6, times=1)
    assert "repeatability_mm" not in told(path)
    result = told(write(tmp_path, targets=4, times=2, same_wrist=True, seed=3, kind="universal"))
    assert result["repeatability_mm"]["applied"]
    result = told(write(tmp_path, targets=3, times=2, same_wrist=True, seed=3))
    assert not result["repeatability_mm"]["applied"]


def test_a_direction_that_was_not_measured_has_no_repeatability(tmp_path):
    path = write(tmp_path, times=6, sigma="sigma_mm = [0.4, 0.1]")
    path.write_text(path.read_text().replace("[0.4, 0.1]", "[0.4, inf]", 6))
    result = told(path)["repeatability_mm"]
    assert result["axial"] is None
    assert not result["applied"]
