"""Orientation of a tool by two more points, as pendants do with six points."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import ConfigError, NotObservable
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([30.0, -12.0, 140.0])
PLACE = np.array([420.0, -80.0, 50.0])
TOOL = Rotation.from_euler("xyz", [0.4, -0.7, 0.2])
UNIT = {"x": [1.0, 0, 0], "y": [0, 1.0, 0], "z": [0, 0, 1.0]}


def write(folder, *, noise=0.0, seed=0, axes=("+z", "+x"), far=(80.0, 80.0), kind="fixed-point"):
    """Eight touches of a point; then the point lies `far` mm away on two axes of the tool."""
    rng = np.random.default_rng(seed)
    fmt = RotationFormat.KUKA_ABC_DEG
    lines = [f'kind = "{kind}"', "[poses]", 'unit = "mm"', f'rotation = "{fmt}"']
    places = [(None, np.zeros(3))] * 8
    for axis, mm in zip(axes, far, strict=True):
        along = np.array(UNIT[axis[1]]) * (1 if axis[0] == "+" else -1)
        places.append((axis, mm * along))
    for i, (axis, in_tool) in enumerate(places):
        R = Rotation.from_rotvec([np.pi, 0, 0]) * Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3))
        in_wrist = TCP + TOOL.apply(in_tool)
        t = PLACE + noise * rng.normal(size=3) - R.apply(in_wrist)
        pose = [float(v) for v in (*t, *rotation_to(R.as_matrix(), fmt))]
        lines += [f"[[{'orientation' if axis else 'touch'}]]", f'name = "{i}"', f"pose = {pose}"]
        lines += [f'point_on = "{axis}"'] if axis else []
    path = folder / "six.toml"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("axes", [("+z", "+x"), ("-x", "+y"), ("+y", "-z"), ("+x", "+z")])
def test_two_more_points_give_the_orientation(tmp_path, axes):
    result = solve_touches(write(tmp_path, axes=axes)).to_json()
    expected = np.eye(4)
    expected[:3, :3], expected[:3, 3] = TOOL.as_matrix(), TCP
    np.testing.assert_allclose(result["wrist_from_tool"], expected, atol=1e-6)
    kuka = rotation_to(TOOL.as_matrix(), RotationFormat.KUKA_ABC_DEG)
    np.testing.assert_allclose(result["tool_rotation"], kuka, atol=1e-6)
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_its_covariance_is_as_large_as_its_errors(tmp_path):
    squares, inside = [], 0
    for seed in range(60):
        result = solve_touches(write(tmp_path, noise=0.233, seed=seed)).to_json()
        R = Rotation.from_matrix(np.array(result["wrist_from_tool"])[:3, :3])
        off = (R * TOOL.inv()).as_rotvec()
        squares.append(off @ np.linalg.solve(result["rotation_covariance"], off))
        inside += np.degrees(np.linalg.norm(off)) < result["rotation_u95_deg"]
    assert 1.2 < np.mean(squares) < 4.0  # of 3; widened by the spread of the levels
    assert inside >= 53


def test_points_that_tell_no_orientation_are_refused(tmp_path):
    with pytest.raises(NotObservable, match="mm from the tip"):
        solve_touches(write(tmp_path, far=(80.0, 1.0)))
    with pytest.raises(ConfigError, match="give two poses"):
        solve_touches(write(tmp_path, axes=("+z", "-z")))
    path = write(tmp_path)
    path.write_text(path.read_text().replace('"+x"', '"x"'))
    with pytest.raises(ConfigError, match="point_on: 'x' is unknown"):
        solve_touches(path)
    with pytest.raises(ConfigError, match="has no fixed point"):
        solve_touches(write(tmp_path, kind="plane"))


def test_a_file_without_them_has_no_orientation(tmp_path):
    result = solve_touches(write(tmp_path, axes=(), far=())).to_json()
    assert "wrist_from_tool" not in result
