"""`vgrd import`: writes the dataset, tells what was assumed, overwrites nothing."""

import json

from scipy.spatial.transform import Rotation

from vgrd.geometry import Pose


def table(folder):
    lines = ["x,y,z,qx,qy,qz,qw,cam_x,cam_y,cam_z,cam_qx,cam_qy,cam_qz,cam_qw"]
    hand_eye = Pose.from_rotvec([2.1, -0.5, 0.3], [850, 120, 680])
    for i in range(5):
        seen = Pose.from_rotvec(
            [0.3 * i, 0.2 - 0.1 * i, 0.1 * i * i], [10.0 * i, -20, 400 + 30 * i]
        )
        numbers = []
        for pose in (hand_eye @ seen, seen):
            numbers += [*pose.translation, *Rotation.from_matrix(pose.rotation).as_quat()]
        lines.append(",".join(f"{number:.12g}" for number in numbers))
    path = folder / "poses.csv"
    path.write_text("\n".join(lines))
    return path


def test_the_dataset_is_written_and_the_assumptions_are_told(vgrd, tmp_path):
    source, out = table(tmp_path), tmp_path / "d.toml"
    done = vgrd("import", source, "--out", out, "--json", "-")
    assert done.result["samples"] == 5
    assert done.result["kind"] == "camera_from_target"
    assert any(
        sentence.startswith("mount = eye-to-hand: so the") for sentence in done.result["assumed"]
    )
    written = out.read_text()
    assert all(f"# - {sentence}" in written for sentence in done.result["assumed"])
    again = vgrd("import", source, "--out", out)
    assert again.code == 65
    assert "is there already" in " ".join(again.err.split())


def test_what_is_meant_is_said_as_key_and_value(vgrd, tmp_path):
    source, out = table(tmp_path), tmp_path / "d.toml"
    assert "write KEY=VALUE" in vgrd("import", source, "--out", out, "--as", "metres").err
    done = vgrd("import", source, "--out", out, "--as", "unit=m")
    assert done.code == 0
    assert "lengths in m: as --as says" in " ".join(done.out.split())
    assert 'unit = "m"' in out.read_text()


def test_a_camera_of_several_and_one_without_a_size(vgrd, tmp_path):
    cameras = {
        name: {"K": [9, 0, i, 0, 9, 2, 0, 0, 1]} for i, name in enumerate(("left", "right"))
    }
    (tmp_path / "c.json").write_text(json.dumps(cameras))
    done = vgrd("camera", tmp_path / "c.json")
    assert "choose with --camera-name" in " ".join(done.err.split())
    words = ("--camera-name", "right", "--size-px", "4x4", "--json", "-")
    assert vgrd("camera", tmp_path / "c.json", *words).result["matrix"] == [9, 9, 1, 2]
    assert "write width x height" in vgrd("camera", tmp_path / "c.json", "--size-px", "4").err
