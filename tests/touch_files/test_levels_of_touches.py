"""The level of the touches is found in them; what a file states is its prior."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([12.0, -7.0, 148.0])
FORMAT = RotationFormat.RPY_FIXED_XYZ_DEG
NOISE_MM = np.array([0.4, 0.4, 0.1])


def write(folder, *, kind="universal", targets=4, times=4, seed=1, sigma="", noise=NOISE_MM):
    """`times` touches of each target; noise 0.4 mm across and 0.1 mm along the tool."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-90, 90, (targets, 3)) * (kind == "universal")
    lines = [f'kind = "{kind}"', "[poses]", 'unit = "mm"', f'rotation = "{FORMAT}"']
    down = Rotation.from_rotvec([np.pi, 0, 0])
    for k, point in enumerate(points):
        for i, tilt in enumerate(rng.uniform(-0.6, 0.6, (times, 3))):
            R = (down * Rotation.from_rotvec(tilt)).as_matrix()
            at = point + np.array((400.0, 100.0, 60.0)) - R @ (TCP + rng.normal(size=3) * noise)
            pose = [float(v) for v in (*at, *rotation_to(R, FORMAT))]
            lines += ["[[touch]]", f'name = "p{k}.{i}"', f"pose = {pose}", sigma]
            lines += [f"target = {point.tolist()}"] if kind == "universal" else []
    path = folder / "touches.toml"
    path.write_text("\n".join(lines))
    return path


def told(path, **options):
    return json.loads(json.dumps(solve_touches(path, **options).to_json(), allow_nan=False))


@pytest.mark.parametrize(
    ("kind", "targets", "times"),
    [("universal", 5, 4), ("universal", 16, 1), ("fixed-point", 1, 16)],
)
def test_the_level_is_found_across_and_along_the_tool(tmp_path, kind, targets, times):
    logs, inside = [], 0
    for seed in range(30):
        path = write(tmp_path, seed=seed, kind=kind, targets=targets, times=times)
        levels = told(path)["levels"]
        logs.append(np.log([level["found"] for level in levels]))
        inside += sum(
            level["low"] < true < level["high"]
            for level, true in zip(levels, (0.4, 0.1), strict=True)
        )
        assert [level["stated"] for level in levels] == [0.233, 0.233]
    across, along = np.exp(np.mean(logs, axis=0))
    assert across == pytest.approx(0.4, rel=0.1)
    assert along == pytest.approx(0.1, rel=0.25)
    assert inside >= 48


def test_the_found_levels_make_the_tcp_better_than_equal_ones(tmp_path):
    squares = []
    for sigma in ("", "sigma_mm = [0.233, 0.233]"):
        off = [
            np.subtract(told(write(tmp_path, seed=s, sigma=sigma))["tcp_in_wrist"], TCP)
            for s in range(25)
        ]
        squares.append(np.mean(np.square(off)))
    told_right = [
        np.subtract(
            told(write(tmp_path, seed=s, sigma="sigma_mm = [0.4, 0.1]"))["tcp_in_wrist"], TCP
        )
        for s in range(25)
    ]
    assert max(squares) < 1.15 * np.mean(np.square(told_right))


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("times", [8, 16])
def test_the_radius_holds_95_percent_whatever_was_stated(tmp_path, factor, times):
    inside = 0
    for seed in range(100):
        sigma = f"sigma_mm = [{0.4 / factor}, {0.4 / factor}]"
        path = write(
            tmp_path,
            kind="fixed-point",
            targets=1,
            times=times,
            seed=seed,
            sigma=sigma,
            noise=np.full(3, 0.4),
        )
        result = told(path)
        inside += np.linalg.norm(np.subtract(result["tcp_in_wrist"], TCP)) < result["u95_mm"]
    assert inside >= 88  # of 100: 92 less 1.5 sigma


def test_a_level_far_from_what_was_stated_is_told_with_both_figures(tmp_path):
    path = write(tmp_path, sigma="sigma_mm = [0.1, 0.1]", times=6)
    (found,) = told(path)["verdict"]["findings"]
    assert found["code"] == "touches_scatter"
    assert "mm across the tool (the file says 0.1)" in found["message"]
    assert told(path)["verdict"]["ok"]
    assert told(write(tmp_path, sigma="sigma_mm = [0.4, 0.1]"))["verdict"]["findings"] == []


def test_touches_without_sigma_have_a_level_of_their_own(tmp_path):
    path = write(tmp_path, times=8, sigma="sigma_mm = [0.4, 0.1]")
    path.write_text(path.read_text().replace("sigma_mm = [0.4, 0.1]", "", 16))
    levels = told(path)["levels"]
    assert [level["stated"] for level in levels] == [0.4, 0.1, 0.233, 0.233]
    assert [level["found"] for level in levels] == pytest.approx([0.4, 0.1, 0.4, 0.1], rel=0.5)


def test_a_direction_that_was_not_measured_has_no_level(tmp_path):
    path = write(tmp_path, times=8, sigma="sigma_mm = [0.4, 0.1]")
    path.write_text(path.read_text().replace("[0.4, 0.1]", "[0.4, inf]", 30))
    across, along = told(path)["levels"]
    assert across["high"] / across["low"] < 2
    assert along["high"] / along["low"] > 3


def test_the_first_line_says_how_well_the_tip_is_known_and_judges_by_a_tolerance_only(tmp_path):
    path = write(tmp_path, sigma="sigma_mm = [0.4, 0.1]")
    result = told(path)
    known = f"at 95 % the tip is known to within {result['u95_mm']:.2f} mm, from 16 touches"
    assert result["summary"] == f"{known}; no tolerance given"
    assert told(path, tolerance_mm=2.0)["summary"] == f"{known}; the tolerance is 2 mm"
    strict = told(path, tolerance_mm=0.01)
    assert strict["verdict"]["findings"][0]["code"] == "tcp_beyond_tolerance"
    assert strict["summary"].startswith("not to be used: at 95 %")
