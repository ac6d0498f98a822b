"""Touches of a plane and of a ball that contradict what is stated of it, or each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import NotObservable
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([14.0, -9.0, 151.0])
NOISE_MM = 0.2
BALL_MM = 25.0
PLANE_Z = 50.0


def write(folder, kind, seed, *, n=14, head="", moved=(), shift=(0, 0, 0), read="rotvec"):
    """Touches of the plane z = 50 or of a ball of 25 mm, those in `moved` of one that stood off by shift (3,) mm."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform((-0.6, -0.6, -1), (0.6, 0.6, 1), (n, 3))
    R = Rotation.from_rotvec([np.pi, 0, 0]) * Rotation.from_rotvec(turns)
    if kind == "plane":
        tips = rng.uniform((300, -250, PLANE_Z), (700, 250, PLANE_Z), (n, 3))
    else:
        up = np.abs(rng.normal(size=(n, 3))) * np.sign(rng.normal(size=(n, 3))) ** (1, 1, 2)
        tips = np.array([500, 50, 80]) + BALL_MM * up / np.linalg.norm(up, axis=1)[:, None]
    tips[list(moved)] += shift
    positions = tips - R.apply(TCP) + rng.normal(0, NOISE_MM, (n, 3))
    lines = [f'kind = "{kind}"', head, "[poses]", 'unit = "mm"', f'rotation = "{read}"']
    for i, (p, turn) in enumerate(zip(positions, R, strict=True)):
        numbers = rotation_to(turn.as_matrix(), RotationFormat(WRITTEN.get(read, read)))
        lines += ["[[touch]]", f'name = "{i + 1}"', f"pose = {[float(v) for v in (*p, *numbers)]}"]
    path = folder / "touches.toml"
    path.write_text("\n".join(lines))
    return path


WRITTEN = {"quaternion-xyzw": "quaternion-wxyz", "kuka-abc-deg": "rpy-fixed-xyz-deg"}  # as read


def told(path):
    """Code and message of everything that is found, of a refusal too."""
    try:
        return {one.code: one.message for one in solve_touches(path).verdict.findings}
    except NotObservable as error:
        return {"refused": str(error)}


@pytest.mark.parametrize("off", [10.0, -14.0])
def test_a_plane_that_is_stated_too_high_or_too_low_is_refused_with_the_found_one(tmp_path, off):
    head = f"plane = {{normal = [0, 0, 1], point = [0, 0, {PLANE_Z + off}]}}"
    for seed in range(4):
        message = told(write(tmp_path, "plane", seed, n=16, head=head))["plane_off"]
        height = float(message.split(" mm (sigma ")[0].split()[-1])
        sigma = float(message.split(" mm (sigma ")[1].split(")")[0])
        assert abs(height + off) < 4.5 * sigma  # of 8 to 10 degrees of freedom
        assert sigma < 3


def test_a_plane_that_is_stated_tilted_is_refused(tmp_path):
    tilted = "plane = {normal = [0, 0.02, -1], point = [500, 0, 50]}"  # the normal may point down
    found = told(write(tmp_path, "plane", 3, n=16, head=tilted))["plane_off"]
    assert "tilted by 1." in found  # 0.02 rad are 1.15 degrees


@pytest.mark.parametrize("stated", [20.0, 24.0, 26.0, 31.0])
def test_a_radius_that_is_stated_wrong_is_refused_with_the_found_one(tmp_path, stated):
    head = f"sphere = {{radius_mm = {stated}}}"
    for seed in range(2):
        (message,) = told(write(tmp_path, "sphere", seed, n=24, head=head)).values()
        assert f"{stated:g} mm is stated" in message
        radius = float(message.split("the radius is ")[1].split()[0])
        assert radius == pytest.approx(BALL_MM, abs=0.6)


@pytest.mark.parametrize(
    ("kind", "head"),
    [
        ("plane", "plane = {normal = [0, 0, 1], point = [0, 0, 50]}"),
        ("sphere", "sphere = {radius_mm = 25}"),
    ],
)
def test_what_is_stated_right_is_not_doubted(tmp_path, kind, head):
    for seed in range(12):
        assert told(write(tmp_path, kind, seed, head=head)).keys() <= {"touch_outlier"}


@pytest.mark.parametrize(
    ("kind", "name", "shift", "most_refused"),
    [("plane", "the plane", (0, 0, 5), 0), ("sphere", "the ball", (5, -2, 0), 3)],
)
def test_a_surface_that_moved_between_two_touches_is_named(
    tmp_path, kind, name, shift, most_refused
):
    refused = 0  # a ball of two places can shrink to nothing in the fit
    for seed in range(3, 8):
        found = told(write(tmp_path, kind, seed, n=18, moved=range(8, 18), shift=shift))
        refused += "refused" in found
        if "refused" not in found:
            assert f"{name} moved" in found["reference_moved"]
            assert "between touch '8' and '9'" in found["reference_moved"]
    assert refused <= most_refused


@pytest.mark.parametrize("kind", ["plane", "sphere"])
@pytest.mark.parametrize("read", WRITTEN)
def test_orientations_of_another_format_are_named(tmp_path, kind, read):
    (message,) = told(write(tmp_path, kind, 4, n=16, read=read)).values()
    assert f'when rotation = "{WRITTEN[read]}": correct' in message
