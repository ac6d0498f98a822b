"""`vgrd tcp`: the table, the JSON and the exit codes."""

import json

import numpy as np
from scipy.spatial.transform import Rotation

TCP = np.array([10.0, -20.0, 150.0])


def touches(m=8, mirrored=False):
    rng = np.random.default_rng(0)
    wrists = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (m, 3)))
    targets = rng.uniform(-80, 80, (m, 3))
    positions = targets + np.array([500, 0, 200]) - wrists.apply(TCP) + rng.normal(0, 0.1, (m, 3))
    lines = ['kind = "universal"', "[poses]", 'unit = "mm"', 'rotation = "quaternion-xyzw"']
    for i in range(m):
        pose = np.concatenate([positions[i], wrists[i].as_quat()]).tolist()
        target = (targets[i] * (1, 1, -1 if mirrored else 1)).tolist()
        lines += ["[[touch]]", f'name = "p{i + 1}"', f"pose = {pose}", f"target = {target}"]
    return "\n".join(lines)


def test_touches_in_a_file_give_the_tcp_as_a_table_and_as_json(vgrd, tmp_path):
    source, out = tmp_path / "touches.toml", tmp_path / "out.json"
    source.write_text(touches())
    done = vgrd("tcp", source, "--json", out)
    assert done.code == 0
    assert "p8" in done.out
    result = json.loads(out.read_text())
    np.testing.assert_allclose(result["tcp_in_wrist"], TCP, atol=0.6)
    assert result["certificate"]["tight"]
    assert result["verdict"] == {"ok": True, "findings": []}


def test_a_mistake_in_the_file_is_named_and_told_by_the_exit_code(vgrd, tmp_path):
    source = tmp_path / "touches.toml"
    source.write_text(touches(mirrored=True))
    done = vgrd("tcp", source, "--json", "-")
    assert done.code == 65
    assert json.loads(done.out)["verdict"]["findings"][0]["code"] == "points_mirrored"


def test_faults_of_the_file_are_told_without_a_result(vgrd, tmp_path):
    source, out = tmp_path / "touches.toml", tmp_path / "out.json"
    source.write_text(touches(m=3).replace("target", "targt"))
    done = vgrd("tcp", source, "--json", out)
    assert done.code == 78
    assert "at least 4" in done.err
    assert "did you mean 'target'" in done.err
    assert not out.exists()


def test_touches_by_a_4_axis_arm_are_told_what_stays_open(vgrd, tmp_path):
    turns = Rotation.from_rotvec(np.linspace(-0.5, 0.5, 6)[:, None] * (0, 0, 1))
    positions = np.array([500, 0, 200]) - turns.apply(TCP)
    lines = ['kind = "fixed-point"', "[poses]", 'unit = "mm"', 'rotation = "quaternion-xyzw"']
    for i, (position, turn) in enumerate(zip(positions, turns.as_quat(), strict=True)):
        pose = [*position.tolist(), *turn.tolist()]
        lines += ["[[touch]]", f'name = "p{i + 1}"', f"pose = {pose}"]
    source = tmp_path / "touches.toml"
    source.write_text("\n".join(lines))
    done = vgrd("tcp", source)
    assert done.code != 0
    assert "5 of 6 unknowns" in done.err + done.out
    assert "the wrist turned about one axis only" in done.err + done.out


def test_what_refuses_the_tcp_is_told_once_with_its_code(vgrd, tmp_path):
    source = tmp_path / "touches.toml"
    source.write_text(touches(mirrored=True))
    done = vgrd("tcp", source)
    told = " ".join(done.out.split())
    assert told.count("the touches fit the mirror image") == 1
    assert told.count("points_mirrored") == 1
