import numpy as np
import pytest

from fakes.world.arm import Arm
from fakes.world.arm_errors import ErrorField
from fakes.world.layout import Layout
from vgrd.geometry import Pose

LAYOUT = Layout()
TCP = LAYOUT.wrist_from_pendant_tcp
HOME = LAYOUT.base_from_wrist_home
ELSEWHERE = Pose.from_rotvec((2.9, 0.3, 0.2), (460.0, 40.0, 230.0))


def arm(**options):
    return Arm(HOME, TCP, seed=3, **options)


def test_a_move_is_executed_with_the_active_tcp():
    robot = arm(repeatability_mm=0.0)
    arrival = robot.move_tcp(ELSEWHERE, 10.0)
    flange = robot.reported_flange(arrival)
    assert np.allclose(flange.matrix(), (ELSEWHERE @ TCP.inverse()).matrix(), atol=1e-9)
    assert np.allclose(robot.reported_tcp(arrival).matrix(), ELSEWHERE.matrix(), atol=1e-9)


def test_another_active_tcp_sends_the_flange_elsewhere():
    robot = arm()
    robot.wrist_from_tcp = Pose.identity()
    arrival = robot.move_tcp(ELSEWHERE, 0.0)
    assert np.allclose(robot.reported_flange(arrival).matrix(), ELSEWHERE.matrix(), atol=1e-9)


def test_moves_start_and_end_at_rest_and_arrive_when_told():
    robot = arm()
    arrival = robot.move_flange(ELSEWHERE, 5.0)
    assert robot.moving(arrival - 1e-6)
    assert not robot.moving(arrival)
    assert robot.reported_flange(5.0).distance(HOME) == pytest.approx((0, 0), abs=1e-7)
    assert robot.reported_flange(arrival).distance(ELSEWHERE) == pytest.approx((0, 0), abs=1e-7)
    for moment in (5.0, arrival, arrival + 1):
        assert not robot.velocity(moment).any()


def test_velocity_is_the_derivative_of_the_reported_pose():
    robot = arm()
    arrival = robot.move_flange(ELSEWHERE, 0.0)
    step = 1e-5
    for moment in np.linspace(0.1, 0.9, 5) * arrival:
        before, after = robot.reported_flange(moment - step), robot.reported_flange(moment + step)
        turn = Pose(after.rotation @ before.rotation.T, np.zeros(3)).rotvec()
        way = after.translation - before.translation
        numeric = np.concatenate([way, turn]) / (2 * step)
        assert np.allclose(robot.velocity(moment), numeric, rtol=1e-4, atol=1e-4)


def test_speed_stays_below_the_limit():
    robot = arm(speed_mm_s=200.0)
    arrival = robot.move_flange(ELSEWHERE, 0.0)
    speeds = [np.linalg.norm(robot.velocity(t)[:3]) for t in np.linspace(0, arrival, 101)]
    assert max(speeds) <= 200.0 + 1e-9


def test_a_new_move_starts_where_the_arm_is():
    robot = arm()
    halfway = robot.move_flange(ELSEWHERE, 0.0) / 2
    there = robot.true_flange(halfway)
    robot.move_flange(HOME, halfway)
    assert robot.true_flange(halfway).distance(there) == pytest.approx((0, 0), abs=1e-7)


def test_repeatability_is_drawn_per_move_with_the_given_rms():
    robot = arm(repeatability_mm=0.03)
    deviations = []
    now = 0.0
    for i in range(400):
        now = robot.move_flange(ELSEWHERE if i % 2 else HOME, now)
        miss = robot.true_flange(now).translation - robot.reported_flange(now).translation
        deviations.append(miss)
        assert np.array_equal(
            miss, robot.true_flange(now + 9).translation - robot.reported_flange(now).translation
        )
    rms = np.sqrt(np.mean(np.sum(np.square(deviations), 1)))
    assert rms == pytest.approx(0.03, rel=0.1)
    assert np.abs(np.mean(deviations, 0)).max() < 0.004


def test_the_error_field_peaks_at_the_given_size_and_is_smooth():
    field = ErrorField.random(5, 0.2, LAYOUT.workspace_mm)
    rng = np.random.default_rng(0)
    points = rng.uniform(*LAYOUT.workspace_mm, (400, 3))
    sizes = [np.linalg.norm(field.tangent(p)[:3]) for p in points]
    assert max(sizes) < 0.2 * 1.05
    assert max(sizes) > 0.12
    assert max(np.linalg.norm(field.tangent(p)[3:]) for p in points) < 5e-4
    near = [
        np.abs(field.tangent(p + np.array([1.0, 0.0, 0.0])) - field.tangent(p)).max()
        for p in points
    ]
    assert max(near) < 0.005


def test_without_errors_the_arm_is_where_it_says():
    robot = arm(repeatability_mm=0.0)
    arrival = robot.move_flange(ELSEWHERE, 0.0)
    assert np.array_equal(
        robot.true_flange(arrival).matrix(), robot.reported_flange(arrival).matrix()
    )


def test_jogging_reaches_a_true_pose_through_all_errors():
    robot = arm(repeatability_mm=0.5, field=ErrorField.random(5, 0.2, LAYOUT.workspace_mm))
    arrival = robot.jog_to_true(ELSEWHERE, 0.0)
    assert robot.true_flange(arrival).distance(ELSEWHERE) == pytest.approx((0, 0), abs=1e-7)
    assert robot.reported_flange(arrival).distance(ELSEWHERE)[0] > 0.05


def test_reading_noise_is_optional_and_has_its_sigma():
    assert arm().reported_flange(0.0) is HOME
    robot = arm(reading_noise_mm=0.01)
    readings = [robot.reported_flange(0.0).translation for _ in range(500)]
    assert np.std(readings, 0) == pytest.approx([0.01] * 3, rel=0.15)


def test_the_same_seed_gives_the_same_arm():
    ends = []
    for _ in range(2):
        robot = arm(field=ErrorField.random(5, 0.2, LAYOUT.workspace_mm))
        ends.append(robot.true_flange(robot.move_flange(ELSEWHERE, 0.0)).matrix())
    assert np.array_equal(*ends)
