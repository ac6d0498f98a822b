"""Why touches contradict each other: the place moved, orientations were read otherwise, no tool at all."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import NotObservable
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([12.0, -7.0, 148.0])
PLACE = np.array([400.0, 100.0, 60.0])


def write(folder, seed, *, kind="fixed-point", n=10, noise=0.2, moved=(), shift=0.0, **how):
    """Touches with noise in mm; those in `moved` stood off by `shift` mm in a random direction."""
    rng = np.random.default_rng(seed)
    written, read = (RotationFormat(how.get(key, "rotvec")) for key in ("written", "read"))
    corners = rng.uniform(-90, 90, (5, 3))
    points = corners[np.arange(n) % 5] if kind == "universal" else np.zeros((n, 3))
    tilts = rng.uniform(-how.get("tilt", 0.6), how.get("tilt", 0.6), (n, 3))
    R = (Rotation.from_rotvec([np.pi, 0, 0]) * Rotation.from_rotvec(tilts)).as_matrix()
    tips = PLACE + points
    tips = tips + how.get("draw", rng.normal)(size=(n, 3)) * noise
    direction = rng.normal(size=3)
    tips[list(moved)] += shift * direction / np.linalg.norm(direction)
    positions = tips - R @ how.get("tcp", TCP)
    lines = [f'kind = "{kind}"', "[poses]", 'unit = "mm"', f'rotation = "{read}"']
    for i in range(n):
        pose = [float(v) for v in (*positions[i], *rotation_to(R[i], written))]
        lines += ["[[touch]]", f'name = "{i + 1}"', f"pose = {pose}"]
        lines += [f"target = {points[i].tolist()}"] if kind == "universal" else []
    path = folder / "touches.toml"
    path.write_text("\n".join(lines))
    return path


def found(path):
    return {one.code: one.message for one in solve_touches(path).verdict.findings}


@pytest.mark.parametrize("kind", ["fixed-point", "universal"])
@pytest.mark.parametrize(("n", "first"), [(8, 2), (10, 5), (14, 12)])
def test_a_place_that_moved_between_two_touches_is_named(tmp_path, kind, n, first):
    named = 0
    for seed in range(10):
        moved = range(first, n)
        told = found(write(tmp_path, seed, kind=kind, n=n, moved=moved, shift=2.0))
        message = told.get("reference_moved", "")
        named += f"between touch '{first}' and '{first + 1}'" in message
    assert named >= 9  # 10 sigma


def test_the_tcp_of_both_groups_together_is_told(tmp_path):
    told = found(write(tmp_path, 3, n=12, noise=0.0, moved=range(6, 12), shift=7.0))
    assert "moved 7.0 mm" in told["reference_moved"]
    assert "the TCP is (12.0, -7.0, 148.0)" in told["reference_moved"]
    assert "touches '1' to '6' belong together, and '7' to '12'" in told["reference_moved"]


@pytest.mark.parametrize("kind", ["fixed-point", "universal"])
@pytest.mark.parametrize("noise", [0.12, 0.233, 0.47])
def test_touches_rougher_or_better_than_stated_have_not_moved(tmp_path, kind, noise):
    for seed in range(22):
        told = found(write(tmp_path, seed, kind=kind, n=6 + seed % 11, noise=noise))
        assert told.keys() <= {"touches_scatter", "touch_outlier", "weak_motion"}


def test_touches_with_long_tails_have_not_moved(tmp_path):
    def tails(size):
        return rng.standard_t(3, size=size)

    rng = np.random.default_rng(17)
    moved = sum("reference_moved" in found(write(tmp_path, s, draw=tails)) for s in range(60))
    assert moved <= 1


def test_one_bad_touch_is_no_move(tmp_path):
    for bad in (0, 1, 5, 9):
        told = found(write(tmp_path, 5, moved=[bad], shift=6.0))
        assert told.keys() == {"touch_outlier"}


@pytest.mark.parametrize("kind", ["fixed-point", "universal"])
@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("rotvec", "rpy-fixed-xyz"),
        ("rpy-fixed-xyz-deg", "kuka-abc-deg"),
        ("kuka-abc-deg", "rotvec-deg"),
        ("rotvec-deg", "rpy-fixed-xyz"),
        ("zyz-deg", "rpy-fixed-xyz-deg"),
        ("quaternion-wxyz", "quaternion-xyzw"),
        ("quaternion-xyzw", "abb-quaternion-wxyz"),
    ],
)
def test_orientations_that_are_written_in_another_format_are_named(tmp_path, kind, written, read):
    path = write(tmp_path, 2, kind=kind, n=12, written=written, read=read)
    try:
        message = found(path)["rotations_misread"]
    except NotObservable as error:
        message = str(error)
    assert f'when rotation = "{written}": correct' in message


def test_the_right_format_is_not_doubted_by_touches_of_little_tilt(tmp_path):
    for seed in range(20):
        told = found(write(tmp_path, seed, n=8, tilt=0.15, noise=0.4))
        assert "rotations_misread" not in told


def test_inverted_poses_of_touched_cad_points_are_named(tmp_path):
    path = write(tmp_path, 4, kind="universal", n=10, written="rotvec", read="rotvec")
    lines = path.read_text().splitlines()
    for i, line in enumerate(lines):
        if line.startswith("pose ="):
            pose = np.array(json.loads(line.removeprefix("pose = ")))
            R = Rotation.from_rotvec(pose[3:]).inv()
            lines[i] = f"pose = {[*(-R.apply(pose[:3])).tolist(), *R.as_rotvec().tolist()]}"
    path.write_text("\n".join(lines))
    assert "the poses are inverted" in found(path)["rotations_misread"]


def test_poses_of_an_active_tcp_are_asked_about(tmp_path):
    told = found(write(tmp_path, 1, n=8, tcp=np.array([0.3, 0.0, -0.4])))
    assert "were these poses of an active TCP" in told["tcp_at_flange"]


def test_poses_of_an_active_tcp_that_was_taught_wrong_are_asked_about(tmp_path):
    for off in ((8.0, 0.0, 3.0), (-20.0, 15.0, 24.0)):
        solution = solve_touches(write(tmp_path, 1, n=9, tcp=np.array(off)))
        (remark,) = solution.verdict.findings
        assert (remark.code, remark.fatal) == ("tool_short", False)
        assert "active TCP taught wrong" in remark.message
    assert "tool_short" not in found(write(tmp_path, 1, n=9, tcp=np.array([0.0, 0.0, 45.0])))


def pivot(folder, field, *, n=800, read="quaternion-wxyz"):
    """A tracked pointer that pivots about its tip; field: mm by which the tracker is off 100 mm from its middle."""
    rng = np.random.default_rng(n)
    phase = np.linspace(0, 2 * np.pi, n)[:, None] * (5.0, 3.3, 1.7)
    turn = Rotation.from_euler("xyz", 0.5 * np.sin(np.add(phase, (0, 1, 2))))
    R = (turn * Rotation.from_rotvec([2.8, 0.3, 0.2])).as_matrix()
    t = np.array([120.0, -40.0, -900.0]) - R @ TCP
    x, y, z = ((t - t.mean(axis=0)) / 100).T
    t = t + field * np.column_stack([x * y, y**2 - z, x * z + z**2])
    t = t + rng.normal(0, 0.2, (n, 3))
    lines = ['kind = "fixed-point"', "[poses]", 'unit = "mm"', f'rotation = "{read}"']
    for i in range(n):
        pose = [float(v) for v in (*t[i], *rotation_to(R[i], RotationFormat.QUATERNION_WXYZ))]
        lines += ["[[touch]]", f'name = "{i + 1}"', f"pose = {pose}"]
    path = folder / "pivot.toml"
    path.write_text("\n".join(lines))
    return solve_touches(path)


def test_a_distorted_field_is_told_and_the_radius_holds_all_the_same(tmp_path):
    solution = pivot(tmp_path, 3.0)
    codes = [one.code for one in solution.verdict.findings]
    assert "touches_alike" in codes
    assert "reference_moved" not in codes
    off = np.linalg.norm(solution.tcp_in_wrist - TCP)
    assert 0.2 < off < solution.u95_mm
    clean = pivot(tmp_path, 0.0)
    assert clean.verdict.findings == ()
    assert np.linalg.norm(clean.tcp_in_wrist - TCP) < 1.5 * clean.u95_mm
    assert clean.u95_mm < 0.1


def test_a_strong_field_refuses_with_what_it_means_for_the_tip(tmp_path):
    solution = pivot(tmp_path, 20.0)
    (found,) = solution.verdict.findings
    assert found.code == "touches_contradict"
    assert f"known to {solution.u95_mm:.1f} mm at 95 %" in found.message


def test_many_frames_with_a_quaternion_in_the_other_order_are_named(tmp_path):
    (found,) = pivot(tmp_path, 0.0, read="quaternion-xyzw").verdict.findings
    assert 'when rotation = "quaternion-wxyz"' in found.message


def test_touches_that_determine_nothing_are_not_read_otherwise_where_that_fits_badly(tmp_path):
    """Turns about one oblique axis leave the TCP open; other formats make several axes of it, far off any point."""
    rng = np.random.default_rng(6)
    turns = np.linspace(-0.9, 0.9, 8)[:, None] * np.array([0.6, 0.64, 0.48])
    positions = PLACE - Rotation.from_rotvec(turns).apply(TCP) + rng.normal(0, 0.2, (8, 3))
    lines = ['kind = "fixed-point"', "[poses]", 'unit = "mm"', 'rotation = "rotvec"']
    for i, numbers in enumerate(np.hstack([positions, turns]).tolist()):
        lines += ["[[touch]]", f'name = "{i}"', f"pose = {numbers}"]
    path = tmp_path / "touches.toml"
    path.write_text("\n".join(lines))
    with pytest.raises(NotObservable, match=r"^fixed point: 5 of 6 unknowns"):
        solve_touches(path)
