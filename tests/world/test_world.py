import numpy as np
import pytest

from fakes.world.layout import FIXED_POINT, Layout
from fakes.world.poses import WORK_ROTATION, retracted_pose, touch_pose
from fakes.world.world import CellNoise, World, WorldSnapshot

LAYOUT = Layout()


def test_in_a_perfect_world_a_touch_misses_nothing():
    world = World(LAYOUT, 1, CellNoise.none())
    arrival = world.jog_onto("P3", WORK_ROTATION, 0.0)
    assert np.abs(world.miss("P3", arrival)).max() < 1e-9
    assert world.reported_flange(arrival).distance(touch_pose(LAYOUT, "P3"))[0] < 1e-9


def test_in_a_perfect_world_a_move_to_the_turned_target_misses_nothing():
    world = World(LAYOUT, 1, CellNoise.none())
    stands = world.turn_table(1.1, 0.0)
    arrival = world.move_flange(touch_pose(LAYOUT, "P5", 1.1), stands)
    assert np.abs(world.miss("P5", arrival)).max() < 1e-9


def test_a_move_with_the_pendants_tcp_ends_beside_the_target():
    world = World(LAYOUT, 1, CellNoise.none())
    wrong = touch_pose(LAYOUT, "P1") @ LAYOUT.wrist_from_pendant_tcp.inverse()
    arrival = world.move_tcp(wrong, 0.0)
    assert np.linalg.norm(world.miss("P1", arrival)) > 20


def test_touch_noise_is_the_papers_truncated_normal():
    world = World(LAYOUT, 1, CellNoise(repeatability_mm=0.0, field_mm=0.0))
    misses = []
    now = 0.0
    for _ in range(600):
        now = world.jog_onto("P2", WORK_ROTATION, now)
        misses.append(world.miss("P2", now))
    assert np.abs(misses).max() <= 0.7
    assert np.std(misses, 0) == pytest.approx([0.233] * 3, rel=0.1)


def test_a_jogged_touch_misses_by_touch_noise_only_however_bad_the_arm():
    sharp = World(LAYOUT, 1, CellNoise(touch_sigma_mm=0.0, repeatability_mm=1.0, field_mm=2.0))
    arrival = sharp.jog_onto(FIXED_POINT, WORK_ROTATION, 0.0)
    assert np.abs(sharp.miss(FIXED_POINT, arrival)).max() < 1e-6


def test_the_table_turns_in_time_and_stops():
    world = World(LAYOUT, 1)
    stands = world.turn_table(np.pi / 2, 2.0)
    assert world.table_angle(2.0) == 0.0
    assert 0 < world.table_angle((2.0 + stands) / 2) < np.pi / 2
    assert world.table_angle(stands) == world.table_angle(stands + 5) == np.pi / 2


def test_targets_and_tag_b_turn_with_the_table_about_its_axis():
    axis = LAYOUT.base_from_table.rotation[:, 2]
    for angle in (0.0, 1.0, 4.0):
        offset = LAYOUT.target_in_base("P1", angle) - LAYOUT.base_from_table.translation
        assert np.linalg.norm(offset) == pytest.approx(60.0)
        assert offset @ axis == pytest.approx(0.0, abs=1e-9)
    snapshot = WorldSnapshot(tuple(np.eye(4).ravel()), 1.0)
    expected = LAYOUT.base_from_object(1.0) @ LAYOUT.object_from_tag_b
    assert np.allclose(snapshot.base_from_tag("b", LAYOUT).matrix(), expected.matrix())


def test_a_slipped_tag_moves_on_the_object_and_the_targets_stay():
    world = World(LAYOUT, 1, CellNoise.none())
    before = world.snapshot(0.0).base_from_tag("b", LAYOUT)
    world.shift_tag_b(0.3, -0.4)
    after = world.snapshot(0.0).base_from_tag("b", LAYOUT)
    assert before.distance(after) == pytest.approx((0.5, 0.0), abs=1e-7)
    arrival = world.jog_onto("P1", WORK_ROTATION, 0.0)
    assert np.abs(world.miss("P1", arrival)).max() < 1e-9


def test_a_snapshot_survives_json():
    world = World(LAYOUT, 4)
    world.cover("a", "b")
    world.shift_tag_b(0.1, 0.2, 0.003)
    world.switch_lights(on=False)
    snapshot = world.snapshot(3.0)
    assert WorldSnapshot.from_json(snapshot.to_json()) == snapshot


def test_every_exposure_has_a_seed_of_its_own_and_the_same_seed_repeats_the_world():
    first, second = (World(LAYOUT, 4) for _ in range(2))
    histories = []
    for world in (first, second):
        now = world.move_flange(retracted_pose(), 0.0)
        now = world.jog_onto("P1", WORK_ROTATION, now)
        histories.append(
            [world.snapshot(now), world.snapshot(now), world.miss("P1", now).tolist()]
        )
    assert histories[0] == histories[1]
    assert histories[0][0].exposure != histories[0][1].exposure
    assert World(LAYOUT, 5).snapshot(0.0).exposure != World(LAYOUT, 4).snapshot(0.0).exposure


def test_an_unknown_target_is_an_error():
    with pytest.raises(KeyError):
        World(LAYOUT, 1).jog_onto("P99", WORK_ROTATION, 0.0)
