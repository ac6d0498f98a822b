"""A 3D camera that saw one point of the tool, or of the base: pose, covariance, causes by name."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError, NotObservable, TooFewObservations
from vgrd.geometry import Pose
from vgrd.solving.datasets import load_dataset, solve_dataset
from vgrd.solving.datasets.point_pairs import solve_point_pairs

TURN = Rotation.from_euler("zyx", [2.0, 0.4, 2.6]).as_matrix()
PLACE = np.array([640.0, 105.0, 1150.0])
BALL = np.array([12.0, -30.0, 95.0])


class Scene:
    """Flange poses, and the ball's place in the camera with noise; no code of the solver draws it."""

    def __init__(self, seed=0, count=12, sigma=0.4, ball=(0, 0, 0), *, turned=True, on_arm=False):
        rng = np.random.default_rng(seed)
        turns = rng.normal(0, 0.5, (count, 3)) if turned else np.zeros((count, 3))
        self.turns = Rotation.from_rotvec(turns) * Rotation.from_rotvec([3.0, 0.2, 0.1])
        self.places = rng.uniform([350, -250, 150], [750, 250, 450], (count, 3))
        if (
            on_arm
        ):  # the ball stands in the base at BALL + (500, 0, 0), the camera at TURN, (40, 5, 90)
            self.camera_turn, self.camera_place = TURN, np.array([40.0, 5.0, 90.0])
            target = BALL + np.array([500, 0, 0])
            in_wrist = self.turns.inv().apply(target - self.places)
            seen = (in_wrist - self.camera_place) @ TURN
        else:
            self.camera_turn, self.camera_place = TURN, PLACE
            seen = (self.places + self.turns.apply(ball) - PLACE) @ TURN
        self.seen = seen + rng.normal(0, sigma, seen.shape)
        self.mount = "eye-in-hand" if on_arm else "eye-to-hand"

    def write(self, folder, *, seen=None, unit="mm", extra=""):
        lines = [
            f'mount = "{self.mount}"',
            extra,
            "[poses]",
            f'unit = "{unit}"',
            'rotation = "quaternion-xyzw"',
        ]
        for i, (place, turn, point) in enumerate(
            zip(self.places, self.turns, self.seen if seen is None else seen, strict=True)
        ):
            shown = place / (1000 if unit == "m" else 1)
            lines += [
                "[[sample]]",
                f'name = "{i}"',
                f"pose = {[*shown.tolist(), *turn.as_quat().tolist()]}",
            ]
            lines.append(f"point_in_camera = {point.tolist()}")
        path = folder / "dataset.toml"
        path.write_text("\n".join(lines))
        return path

    def error(self, X):
        """Left tangent from the truth to an estimate (4, 4), and the place's error."""
        truth = np.eye(4)
        truth[:3, :3], truth[:3, 3] = self.camera_turn, self.camera_place
        return (Pose.from_matrix(np.array(X)) @ Pose.from_matrix(truth).inverse()).log()


def codes(result):
    return [found["code"] for found in result["verdict"]["findings"]]


def solve(path):
    return json.loads(json.dumps(solve_dataset(path).to_json(), allow_nan=False))


@pytest.mark.parametrize(
    ("options", "extra", "unknowns"),
    [
        ({"turned": False}, "", 6),
        ({"ball": BALL}, f"tcp_in_wrist = {BALL.tolist()}", 6),
        ({"ball": BALL}, 'tcp_in_wrist = "unknown"', 9),
        ({"on_arm": True}, "", 9),
    ],
    ids=["flange", "ball", "unknown ball", "on the arm"],
)
def test_the_pose_is_true_within_its_covariance(tmp_path, options, extra, unknowns):
    """Squared errors over the covariance's scale follow F; 60 recordings of 12 points."""
    normalised, covered = [], 0
    for seed in range(60):
        scene = Scene(seed, **options)
        result = solve(scene.write(tmp_path, extra=extra))
        name = "wrist_from_camera" if options.get("on_arm") else "base_from_camera"
        xi = scene.error(result[name])
        covariance = np.array(result["covariance"])
        freedom = 3 * 12 - unknowns
        normalised.append(xi @ np.linalg.solve(covariance, xi) / 6)
        middle = scene.seen.mean(0)
        X = np.array(result[name])
        truth = scene.camera_turn @ middle + scene.camera_place
        covered += np.linalg.norm(X[:3, :3] @ middle + X[:3, 3] - truth) < result["u95_mm"]
        assert result["verdict"]["ok"] is None  # nothing is wrong, and no tolerance was given
    # The mean of F is f / (f - 2), the covariance is wider by just that: 1 remains, +- 0.58 / sqrt(60).
    assert freedom > 2
    assert 0.75 < np.mean(normalised) < 1.3
    assert covered >= 54


def test_a_flange_that_never_turned_is_told_as_the_report_of_others_was(tmp_path):
    result = solve(Scene(3, count=20, sigma=0.3, turned=False).write(tmp_path, unit="m"))
    assert result["level_mm"] == pytest.approx(0.3, rel=0.25)
    assert result["leave_one_out"]["mm"] == pytest.approx(0.3 * np.sqrt(3), rel=0.5)
    assert result["scale"]["value"] == pytest.approx(1, abs=5e-3)
    assert codes(result) == []
    answer = solve_dataset(tmp_path / "dataset.toml").sentence
    assert answer.startswith("at 95 % a point amid the samples is placed to within")


def test_a_further_look_is_within_what_is_told_and_judged_by_the_tolerance(tmp_path):
    within = 0
    for seed in range(60):
        scene = Scene(seed, count=13)
        for array in ("places", "seen"):
            setattr(scene, f"whole_{array}", getattr(scene, array))
            setattr(scene, array, getattr(scene, array)[1:])
        scene.turns = scene.turns[1:]
        solution = solve_dataset(scene.write(tmp_path))
        predicted = solution.fit.X @ scene.whole_seen[0]
        bound = solution.fit.u95_mm(scene.whole_seen[0], of_a_look=True)
        within += np.linalg.norm(predicted - scene.whole_places[0]) < bound
    assert within >= 53
    dataset = load_dataset(tmp_path / "dataset.toml")
    look = solution.look_u95_mm
    assert solution.u95_mm < look
    assert solve_point_pairs(dataset, tolerance_mm=1.1 * look).verdict.ok
    told = solve_point_pairs(dataset, tolerance_mm=0.9 * look).verdict
    assert [found.code for found in told.findings if found.fatal] == ["tolerance_exceeded"]


def test_a_ball_that_is_not_at_the_flange_is_named(tmp_path):
    result = solve(Scene(1, count=15, ball=(0, 0, 20)).write(tmp_path))
    assert "tool_point" in codes(result)
    (message,) = [f["message"] for f in result["verdict"]["findings"] if f["code"] == "tool_point"]
    told = [float(word) for word in message.split("is at ")[1].split(" mm")[0].split()]
    assert told == pytest.approx([0, 0, 20], abs=3)


def test_a_point_that_jumped_is_named(tmp_path):
    scene = Scene(2, count=14)
    scene.seen[5] += (6, 0, 0)
    result = solve(scene.write(tmp_path))
    named = [f["message"] for f in result["verdict"]["findings"] if f["code"] == "sample_rejected"]
    assert len(named) == 1
    assert named[0].startswith("sample 5: ")
    assert result["samples"][5]["reason"]


def test_another_unit_a_mirrored_camera_and_another_order_are_named(tmp_path):
    scene = Scene(4)
    told = solve_dataset(scene.write(tmp_path, seen=scene.seen / 1000)).verdict
    assert not told.ok
    assert "one side is in m, the other in mm" in told.findings[0].message
    told = solve_dataset(scene.write(tmp_path, seen=scene.seen * (1, -1, 1))).verdict
    assert not told.ok
    assert "left-handed" in told.findings[0].message
    told = solve_dataset(scene.write(tmp_path, seen=np.roll(scene.seen, 1, axis=0))).verdict
    assert not told.ok
    assert "in one order" in told.findings[0].message


def test_a_camera_that_measures_too_long_is_named(tmp_path):
    scene = Scene(5, count=15, sigma=0.1)
    result = solve(scene.write(tmp_path, seen=scene.seen * 1.01))
    assert "camera_scale" in codes(result)
    assert result["scale"]["value"] == pytest.approx(1.01, abs=1e-3)


def test_what_leaves_the_pose_open_is_refused(tmp_path):
    scene = Scene(6)
    scene.places[:] = [400, 0, 300] + np.arange(12)[:, None] * np.array([10.0, 5.0, 2.0])
    line = (scene.places - PLACE) @ TURN
    with pytest.raises(NotObservable, match="lie on one line"):
        solve_dataset(scene.write(tmp_path, seen=line))
    still = Scene(7, turned=False)
    with pytest.raises(NotObservable, match="give tcp_in_wrist"):
        solve_dataset(still.write(tmp_path, extra='tcp_in_wrist = "unknown"'))
    few = Scene(8, count=4)
    with pytest.raises(TooFewObservations, match="at least 5 are needed"):
        solve_dataset(few.write(tmp_path, extra='tcp_in_wrist = "unknown"'))
    with pytest.raises(InputError, match="is of poses"):
        solve_dataset(few.write(tmp_path), method="park-martin")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tcp_in_wrist = [0, 0, 1]", "tcp_in_wrist = [0, 1]", "tcp_in_wrist: List should have"),
        ("tcp_in_wrist = [0, 0, 1]", 'tcp_in_wrist = "?"', "tcp_in_wrist: Input should be"),
        ("point_in_camera = [", "point_in_camera = [nan, 1, 2] # [", "point_in_camera.0: Input should be a fin"),
        ("point_in_camera = [", "image = 'a'\npoint_in_camera = [", "has image and point_in_camera"),
    ],
)  # fmt: skip
def test_a_fault_is_named(tmp_path, old, new, message):
    path = Scene(9).write(tmp_path, extra="tcp_in_wrist = [0, 0, 1]")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(Exception, match=message):
        solve_dataset(path)


def test_points_that_were_not_seen_are_dropped_with_a_remark(tmp_path):
    scene = Scene(seed=4, count=14)
    scene.seen[2] = 0.0
    result = solve(scene.write(tmp_path))
    assert [s["name"] for s in result["samples"] if not s["used"]] == ["2"]
    assert codes(result) == ["target_not_seen"]
    assert np.abs(scene.error(result["base_from_camera"])[:3]).max() < 2


def test_a_point_far_off_is_left_out_and_named(tmp_path):
    scene = Scene(seed=4, count=14)
    scene.seen[3] += [20.0, -20.0, 15.0]
    result = solve(scene.write(tmp_path))
    assert [s["name"] for s in result["samples"] if not s["used"]] == ["3"]
    assert "off the fit of the others" in result["samples"][3]["reason"]
    assert codes(result) == ["sample_rejected"]
    assert result["look_u95_mm"] < 3
    assert np.abs(scene.error(result["base_from_camera"])[:3]).max() < 2


def test_a_ball_that_was_not_told_is_found_before_the_points_are_said_to_contradict(tmp_path):
    told = solve_dataset(Scene(seed=4, count=14, ball=(40, -90, 110)).write(tmp_path))
    first = told.verdict.findings[0]
    assert first.code == "contradictory"
    assert 'tcp_in_wrist = "unknown"' in first.message
    found = np.array(first.message.split("is at ")[1].split(" mm")[0].split(), dtype=float)
    assert np.abs(found - [40, -90, 110]).max() < 3


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("", "the flange's centre, as is assumed"),
        ("tcp_in_wrist = [12, -30, 95]", "12.000 -30.000 95.000 mm in the wrist, as given"),
        ('tcp_in_wrist = "unknown"', "estimated"),
    ],
)
def test_what_is_assumed_of_the_point_is_printed(tmp_path, extra, words):
    solution = solve_dataset(Scene(seed=4, count=12, ball=BALL).write(tmp_path, extra=extra))
    assert words in dict(solution.summary_rows())["point"]
