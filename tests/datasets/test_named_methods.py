"""Datasets solved by a published method instead of the default."""

import json

import numpy as np
import pytest

from vgrd.calibration.hand_eye.published import METHODS
from vgrd.cli import main
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.model import Mount
from vgrd.solving.datasets import solve_dataset


def poses_of(result, recording):
    if recording.mount is Mount.EYE_TO_HAND:
        names = ("base_from_camera", "wrist_from_target")
    else:
        names = ("wrist_from_camera", "base_from_target")
    return [Pose.from_matrix(result[name]) for name in names]


@pytest.mark.parametrize("mount", list(Mount))
def test_every_method_finds_the_truth_of_exact_matrices(tmp_path, make_recording, plain, mount):
    recording = make_recording(mount)
    path = recording.write_matrices(tmp_path)
    keys = set(plain(solve_dataset(path)))
    for name in METHODS:
        result = plain(solve_dataset(path, method=name))
        assert set(result) - keys == {"method"}
        assert result["method"] == name
        truth = (recording.X, recording.Y)
        for found, true in zip(poses_of(result, recording), truth, strict=True):
            assert found.distance(true) == pytest.approx((0, 0), abs=1e-4)
        assert result["verdict"] == {"ok": None, "tolerance_mm": None, "findings": []}
        assert result["leave_one_out"]["mm"] < 1e-3
        assert all(sample["used"] for sample in result["samples"])


def test_points_are_solved_by_a_method_through_their_own_poses(tmp_path, recording, plain):
    path = recording.write_points(tmp_path, pixels=recording.pixels(sigma_px=0.2))
    default, named = plain(solve_dataset(path)), plain(solve_dataset(path, method="tsai-lenz"))
    assert "method" not in default
    X, _ = poses_of(named, recording)
    mm, rad = X.distance(recording.X)
    assert mm < 20
    assert rad < 0.02
    assert not np.array_equal(X.matrix(), default["base_from_camera"])
    assert default["leave_one_out"]["px"] < named["leave_one_out"]["px"] < 50
    assert named["target_scale"] == default["target_scale"]
    assert "intrinsics_doubtful" not in [f["code"] for f in named["verdict"]["findings"]]


def test_an_unknown_method_is_answered_with_the_known_ones(tmp_path, recording):
    with pytest.raises(InputError, match=r"'tsai' is unknown; known: tsai-lenz, park-martin.*li$"):
        solve_dataset(recording.write_matrices(tmp_path), method="tsai")


def test_a_method_refines_no_intrinsics_and_says_so(tmp_path, recording):
    with pytest.raises(InputError, match=r"refines no intrinsics: set camera\.refine = false"):
        solve_dataset(recording.write_points(tmp_path, refine=True), method="li")


def test_the_command_line_takes_the_method_by_name(tmp_path, recording, monkeypatch, capsys):
    path, out = recording.write_matrices(tmp_path), tmp_path / "out.json"

    def vgrd(*words):
        monkeypatch.setattr("sys.argv", ["vgrd", "solve", *map(str, words)])
        try:
            main()
        except SystemExit as stop:
            return stop.code or 0
        return 0

    assert vgrd(path, "--method", "daniilidis", "--json", out) == 0
    assert json.loads(out.read_text())["method"] == "daniilidis"
    assert vgrd(path, "--method", "daniels") == InputError.exit_code
    assert vgrd(tmp_path, "--method", "shah") == InputError.exit_code
    told = " ".join(capsys.readouterr().err.split())
    assert "known: tsai-lenz" in told
    assert "name a DATASET.toml" in told
