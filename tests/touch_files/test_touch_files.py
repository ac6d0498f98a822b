import json
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import ConfigError, NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.solving.touch_files import solve_touches

TCP = np.array([12.0, -7.0, 148.0])
OBJECT_FROM_BASE = Pose.from_rotvec((0.1, -0.2, 1.9), (-300, 420, -80))
SIGMA = 0.1
FORMAT = RotationFormat.RPY_FIXED_XYZ_DEG


@dataclass
class File:
    """Touches with known truth; `write` makes a TOML file of them."""

    kind: str = "universal"
    m: int = 10
    seed: int = 1
    planar: bool = False
    noise: float = SIGMA
    head: str = ""
    extra: dict[int, str] = field(default_factory=dict)

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.wrists = Rotation.from_rotvec(np.array([np.pi, 0, 0])) * Rotation.from_rotvec(
            rng.uniform(-0.6, 0.6, (self.m, 3))
        )
        self.targets = rng.uniform(-90, 90, (self.m, 3)) * (1, 1, 0 if self.planar else 1)
        if self.kind == "universal":
            tips = OBJECT_FROM_BASE.inverse() @ self.targets
        elif self.kind == "fixed-point":
            tips = np.tile([400.0, 100, 60], (self.m, 1))
        elif self.kind == "plane":
            tips = np.array([400.0, 100, 60]) + rng.uniform(-150, 150, (self.m, 3)) * (1, 1, 0)
        else:
            u = rng.normal(size=(self.m, 3))
            tips = np.array([400.0, 100, 60]) + 20 * u / np.linalg.norm(u, axis=1)[:, None]
        tips = tips + rng.normal(0, self.noise, (self.m, 3))
        self.positions = tips - self.wrists.as_matrix() @ TCP

    def write(self, path):
        lines = [f'kind = "{self.kind}"', self.head]
        lines += ["[poses]", 'unit = "mm"', f'rotation = "{FORMAT}"']
        for i in range(self.m):
            turn = rotation_to(self.wrists[i].as_matrix(), FORMAT)
            pose = [*self.positions[i], *turn]
            lines += ["[[touch]]", f'name = "p{i + 1}"', f"pose = {[float(v) for v in pose]}"]
            lines += [f"sigma_mm = [{SIGMA}, {SIGMA}]"]
            if self.kind == "universal":
                lines.append(f"target = {[float(v) for v in self.targets[i]]}")
            lines.append(self.extra.get(i, ""))
        path.write_text("\n".join(lines))
        return path


@pytest.fixture
def solve(tmp_path):
    return lambda file: solve_touches(file.write(tmp_path / "touches.toml"))


def codes(solution):
    return [finding.code for finding in solution.verdict.findings]


@pytest.mark.parametrize(
    ("kind", "head"),
    [
        ("universal", ""),
        ("fixed-point", ""),
        ("plane", ""),
        ("plane", "plane = {normal = [0, 0, 2], point = [0, 0, 60]}"),
        ("sphere", ""),
        ("sphere", "sphere = {radius_mm = 20}"),
    ],
)
def test_every_kind_gives_the_tcp_with_an_honest_covariance(solve, kind, head):
    for seed in range(3):
        solution = solve(File(kind, m=16, seed=seed, head=head))
        error = solution.tcp_in_wrist - TCP
        assert np.linalg.norm(error) < 1.0
        assert error @ np.linalg.solve(solution.covariance, error) < 16
        assert solution.verdict.ok
        assert all(touch.used for touch in solution.touches)
        assert all(touch.residual_mm < 0.5 for touch in solution.touches)


def test_the_json_has_the_documented_keys_and_plain_values(solve):
    solution = solve(File()).to_json()
    assert list(solution) == [
        "summary",
        "u95_mm",
        "tolerance_mm",
        "tcp_in_wrist",
        "covariance",
        "object_from_base",
        "touches",
        "levels",
        "certificate",
        "verdict",
    ]
    assert json.loads(json.dumps(solution, allow_nan=False)) == solution
    np.testing.assert_allclose(solution["object_from_base"], OBJECT_FROM_BASE.matrix(), atol=0.6)
    assert np.shape(solution["covariance"]) == (3, 3)
    assert solution["touches"][0].keys() == {"name", "used", "reason", "residual_mm"}
    assert solution["certificate"]["tight"]
    assert solution["certificate"]["gap"] < 1e-6
    assert "object_from_base" not in solve(File("fixed-point")).to_json()


def test_a_bad_touch_is_left_out_and_named(solve):
    file = File()
    file.positions[4] += (1.5, -1.0, 1.0)
    solution = solve(file)
    assert [touch.name for touch in solution.touches if not touch.used] == ["p5"]
    assert "sigma off the others" in solution.touches[4].reason
    assert solution.touches[4].residual_mm == pytest.approx(2.06, abs=0.6)
    assert codes(solution) == ["touch_outlier"]
    assert solution.verdict.ok
    assert np.linalg.norm(solution.tcp_in_wrist - TCP) < 0.5


@pytest.mark.parametrize("m", [5, 6, 8, 12])
def test_two_swapped_targets_are_named(solve, m):
    for seed in range(4):
        file = File(m=m, seed=seed)
        file.targets[[1, 3]] = file.targets[[3, 1]]
        solution = solve(file)
        assert codes(solution)[0] == "targets_swapped"
        assert "'p2' and 'p4'" in solution.verdict.findings[0].message
        assert not solution.verdict.ok


@pytest.mark.parametrize("m", [5, 6, 8, 12])
def test_mirrored_cad_points_are_named(solve, m):
    for seed in range(4):
        file = File(m=m, seed=seed)
        file.targets[:, 1] *= -1
        solution = solve(file)
        assert codes(solution)[0] == "points_mirrored"
        assert not solution.verdict.ok


@pytest.mark.parametrize("change", [lambda p: p[::-1], lambda p: np.roll(p, 2, axis=0)])
def test_targets_in_the_wrong_order_are_named(solve, change):
    file = File(m=8)
    file.targets = change(file.targets)
    solution = solve(file)
    assert codes(solution)[0] == "points_order"
    assert not solution.verdict.ok


def test_touches_of_three_set_ups_contradict_each_other(solve):
    file = File(m=12)
    file.positions[4:] += (8.0, -30.0, 20.0)
    file.positions[8:] += (20.0, 40.0, 0.0)
    solution = solve(file)
    assert not solution.verdict.ok
    assert codes(solution)[0] in ("touches_contradict", "reference_moved")


def test_touches_that_scatter_more_than_promised_enlarge_the_covariance(solve):
    careful, careless = (solve(File(m=12, noise=noise)) for noise in (SIGMA, 5 * SIGMA))
    assert codes(careful) == []
    assert codes(careless) == ["touches_scatter"]
    assert np.trace(careless.covariance) > 9 * np.trace(careful.covariance)


def test_clean_files_raise_no_alarm(solve):
    alarms = sum(bool(codes(solve(File(m=8, seed=seed)))) for seed in range(40))
    assert alarms <= 2


def test_little_tilt_is_told_with_the_direction_and_the_remedy(solve):
    file = File(m=6)
    down = Rotation.from_rotvec([np.pi, 0, 0])
    tips = file.positions + file.wrists.as_matrix() @ TCP
    small = (down.inv() * file.wrists) ** 0.035
    file.wrists = down * small
    file.positions = tips - file.wrists.as_matrix() @ TCP
    solution = solve(file)
    assert codes(solution) == ["weak_motion"]
    assert "tilted further" in solution.verdict.findings[0].message
    assert not solution.verdict.ok


def test_a_constant_wrist_is_refused_with_the_missing_motion(solve):
    file = File(m=6)
    file.wrists = Rotation.from_rotvec(np.tile([np.pi, 0, 0], (6, 1)))
    with pytest.raises(NotObservable, match="kept its orientation"):
        solve(file)


def test_a_direction_that_was_not_measured_is_not_a_residual(solve):
    file = File(m=12)
    axial = file.wrists.as_matrix() @ np.array([0.0, 0.0, 6.0])
    file.positions[:3] += axial[:3]
    file.extra = dict.fromkeys(range(12), "axis = [0, 0, 1]")
    text_of = file.write

    def write(path):
        text = text_of(path).read_text()
        head, *touches = text.split("[[touch]]")
        loose = [t.replace(f"[{SIGMA}, {SIGMA}]", f"[{SIGMA}, inf]") for t in touches[:3]]
        path.write_text("[[touch]]".join([head, *loose, *touches[3:]]))
        return path

    file.write = write
    solution = solve(file)
    assert codes(solution) == []
    assert all(touch.residual_mm < 0.5 for touch in solution.touches)


def faults(tmp_path, text):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        solve_touches(path)
    return list(caught.value.faults)


def test_all_faults_of_a_file_are_told_at_once(tmp_path):
    text = File(m=5).write(tmp_path / "good.toml").read_text()
    lines = text.splitlines()
    poses = [i for i, line in enumerate(lines) if line.startswith("pose =")]
    targets = [i for i, line in enumerate(lines) if line.startswith("target =")]
    lines[poses[0]] = "pose = [nan, 0, 0, 0, 0, 0]"
    lines[poses[1]] = "pose = [1, 2, 3]"
    lines[targets[2]] = "targt = [0, 0, 0]"
    text = "\n".join(lines).replace('kind = "universal"', 'kind = "univresal"')
    found = "\n".join(faults(tmp_path, text.replace('"p5"', '"p4"')))
    for words in (
        "kind: 'univresal' is unknown, did you mean 'universal'?",
        "touch[0] 'p1'.pose.0",
        "touch[1] 'p2'.pose: a pose with rotation",
        "touch[2] 'p3'.targt: unknown key, did you mean 'target'?",
        "'p4' is given 2 times",
    ):
        assert words in found


def test_too_few_touches_missing_targets_and_a_line_are_faults(tmp_path):
    few = File(m=3).write(tmp_path / "few.toml").read_text()
    assert any("3 given, kind universal needs at least 4" in f for f in faults(tmp_path, few))
    bare = "\n".join(line for line in few.splitlines() if not line.startswith("target"))
    (missing,) = (f for f in faults(tmp_path, bare) if "add the CAD point" in f)
    assert missing.startswith("touch[0] 'p1'.target: is missing")
    assert missing.endswith("(and 2 more)")
    file = File(m=6)
    file.targets = np.outer(np.arange(6.0) * 20, (1, 2, 0))
    on_line = file.write(tmp_path / "line.toml").read_text()
    assert any("on one line" in f for f in faults(tmp_path, on_line))
    file.targets = np.ones((6, 3))
    equal = file.write(tmp_path / "line.toml").read_text()
    assert any("all are equal" in f for f in faults(tmp_path, equal))


def test_one_pose_twice_a_wrong_unit_and_strange_axes_are_faults(tmp_path):
    file = File(m=6)
    file.positions[3] = file.positions[1]
    file.wrists = Rotation.from_quat(file.wrists.as_quat()[[0, 1, 2, 1, 4, 5]])
    twice = file.write(tmp_path / "a.toml").read_text()
    assert any("'p2', 'p4' hold the same pose" in f for f in faults(tmp_path, twice))
    metres = File(m=6).write(tmp_path / "b.toml").read_text().replace('"mm"', '"m"')
    assert any("is it mm?" in f for f in faults(tmp_path, metres))
    axes = File(m=6, extra={0: "axis = [0, 0, 1]", 1: "axis = [0, 1, 0]"})
    assert any(
        "one tool has one axis" in f
        for f in faults(tmp_path, axes.write(tmp_path / "c.toml").read_text())
    )
    none = File(m=6, extra={0: "axis = [0, 0, 0]"})
    assert any(
        "no length" in f for f in faults(tmp_path, none.write(tmp_path / "d.toml").read_text())
    )


def test_tables_that_do_not_belong_to_the_kind_are_faults(tmp_path):
    file = File(m=6, head="sphere = {radius_mm = 20}\nplane = {normal = [0,0,0], point = [0,0,0]}")
    found = "\n".join(faults(tmp_path, file.write(tmp_path / "a.toml").read_text()))
    assert "kind universal has no [sphere]" in found
    assert "plane.normal: has no length" in found
    assert any("no such file" in f for f in faults_of_missing(tmp_path))


def faults_of_missing(tmp_path):
    with pytest.raises(ConfigError) as caught:
        solve_touches(tmp_path / "nothing.toml")
    return caught.value.faults


def test_numbers_that_no_touch_has_are_faults(tmp_path):
    text = File(m=6).write(tmp_path / "good.toml").read_text()
    for sigma in ("1e-300, 1e300", "0.0, 1.0", "-1.0, 1.0", "nan, 1.0"):
        found, *_ = faults(tmp_path, text.replace(f"[{SIGMA}, {SIGMA}]", f"[{sigma}]", 1))
        assert "or inf where nothing was measured" in found
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("pose ="))
    lines[first] = "pose = [1e300, 0.0, 0.0, 0.0, 0.0, 0.0]"
    (found,) = faults(tmp_path, "\n".join(lines))
    assert "is it mm?" in found


def test_touches_that_measured_nothing_are_told_as_that(solve):
    file = File("fixed-point", m=10)
    write = file.write
    file.write = lambda path: _with_sigmas(write(path), "[inf, inf]")
    with pytest.raises(TooFewObservations, match="the 10 touches have 0: give sigma_mm"):
        solve(file)


def _with_sigmas(path, sigmas):
    path.write_text(path.read_text().replace(f"[{SIGMA}, {SIGMA}]", sigmas))
    return path


@pytest.mark.parametrize("kind", ["fixed-point", "universal", "plane"])
@pytest.mark.parametrize("form", ["matrix", "matrix-columns", "rows"])
def test_poses_may_be_written_as_matrices(solve, kind, form):
    file = File(kind, m=16)
    numbers = solve(file)
    write = file.write

    def by_matrices(path):
        text = write(path).read_text().splitlines()
        poses = iter(zip(file.wrists.as_matrix(), file.positions, strict=True))
        for i, line in enumerate(text):
            if line.startswith("rotation"):
                text[i] = f'rotation = "{form.replace("rows", "matrix")}"'
            if line.startswith("pose"):
                R, t = next(poses)
                M = np.vstack([np.column_stack([R, t]), [0, 0, 0, 1]])
                M = M.T if form == "matrix-columns" else M
                text[i] = f"pose = {(M if form == 'rows' else M.ravel()).tolist()}"
        path.write_text("\n".join(text))
        return path

    file.write = by_matrices
    solution = solve(file)
    np.testing.assert_allclose(solution.tcp_in_wrist, numbers.tcp_in_wrist, atol=1e-4)
    assert codes(solution) == codes(numbers)


def test_matrices_by_columns_that_are_said_to_be_by_rows_are_a_fault(tmp_path):
    file = File("fixed-point", m=5)
    lines = file.write(tmp_path / "a.toml").read_text().replace(f'"{FORMAT}"', '"matrix"')
    lines = lines.splitlines()
    poses = zip(file.wrists.as_matrix(), file.positions, strict=True)
    for i in [i for i, line in enumerate(lines) if line.startswith("pose")]:
        R, t = next(poses)
        M = np.vstack([np.column_stack([R, t]), [0, 0, 0, 1]]).T
        lines[i] = f"pose = {M.ravel().tolist()}"
    (fault,) = faults(tmp_path, "\n".join(lines))
    assert 'say rotation = "matrix-columns"' in fault
    assert "(and 4 more)" in fault
