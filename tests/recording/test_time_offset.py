"""The time between poses and pictures: found within 3 ms from a jog, or not told."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.world.arm_errors import ArmErrors
from fakes.world.jogged_pictures import Jog, jogged_pictures
from fakes.world.simulation import Simulation
from vgrd.calibration.timing import find_time_offset
from vgrd.clock import SystemClock
from vgrd.devices import FlangeReading
from vgrd.geometry import Pose
from vgrd.geometry.track import PoseTrack
from vgrd.model import Plan, Stability
from vgrd.solving.session import solve_session
from vgrd.store.sessions import SampleKind, SessionWriter

ARM = ArmErrors(sigma_mm=0.03, field_mm=0.1)
WITHIN_S = 3e-3


def found(seed, jog, *, stability=Stability.FIXED, start_off=True):
    cell = Simulation(seed, arm=ARM)
    made = jogged_pictures(cell, jog)
    off = np.random.default_rng(seed).normal(size=6) * ([0.5] * 3 + [1e-3] * 3)
    return find_time_offset(
        replace(cell.facts(), camera_stability=stability),
        PoseTrack.of(made.stamps_s, made.poses),
        made.moving,
        made.rests,
        Pose.exp(off * start_off) @ cell.base_from_camera,
        cell.wrist_from_tag_a,
    )


@pytest.mark.parametrize("skew_s", [0.0, 0.03, 0.1, -0.06])
def test_a_skew_is_found_with_its_sigma(skew_s):
    offset = found(1, Jog(skew_s=skew_s, moves=10))
    assert offset.unknown == ""
    assert abs(offset.offset_s - skew_s) < min(WITHIN_S, 4 * offset.sigma_s)
    assert 0 < offset.sigma_s <= 1e-3
    assert offset.jitter_s < 1e-3


@pytest.mark.parametrize(
    "jog",
    [
        Jog(0.05, roll_s=0.04, moves=12),
        Jog(0.05, jitter_s=0.004, moves=24),
        Jog(0.05, reading_hz=5.0, moves=12),
        Jog(0.05, reading_jitter_s=0.001, moves=16),
        Jog(0.05, speed_mm_s=250.0, moves=20, picture_hz=4.0),
    ],
    ids=["rolling", "jitter", "slow robot", "robot's stamps jitter", "fast"],
)
def test_what_disturbs_the_stamps_is_found_or_told_as_unknown(jog):
    offset = found(2, jog)
    if not jog.jitter_s:
        assert offset.unknown == ""
    if not offset.unknown:
        assert abs(offset.offset_s - jog.skew_s) < WITHIN_S
    if jog.roll_s:
        assert offset.roll_s == pytest.approx(jog.roll_s, abs=0.004)
    if jog.jitter_s:
        assert 0.5 * jog.jitter_s < offset.jitter_s < 2 * jog.jitter_s or offset.unknown


@pytest.mark.parametrize(
    ("jog", "why"),
    [
        (Jog(0.05, moves=1), "are needed: jog with tag A in view"),
        (Jog(0.05, span=0.02), "are needed: jog with tag A in view"),
        (Jog(0.05, jitter_s=0.03, moves=8), "certain to"),
    ],
    ids=["few pictures", "little motion", "wild stamps"],
)
def test_too_little_is_told_as_unknown_with_the_remedy(jog, why):
    offset = found(3, jog)
    assert why in offset.unknown
    assert offset.to_json()["offset_ms"] is None


def test_a_camera_that_people_move_tells_no_offset():
    offset = found(1, Jog(0.05, moves=1), stability=Stability.MOVABLE)
    assert "people move" in offset.unknown


def test_a_wild_picture_does_not_carry_the_offset_away():
    cell = Simulation(4, arm=ARM)
    made = jogged_pictures(cell, Jog(0.02, moves=12))
    wild = replace(made.moving[5].tag_a, camera_from_tag=Pose.identity())
    shifted = made.moving[9].tag_a
    far = Pose.from_rotvec((0, 0, 0), (40.0, 0, 0)) @ shifted.camera_from_tag
    made.moving[5] = replace(made.moving[5], tag_a=wild)
    made.moving[9] = replace(made.moving[9], tag_a=replace(shifted, camera_from_tag=far))
    offset = find_time_offset(
        cell.facts(),
        PoseTrack.of(made.stamps_s, made.poses),
        made.moving,
        made.rests,
        cell.base_from_camera,
        cell.wrist_from_tag_a,
    )
    assert offset.unknown or abs(offset.offset_s - 0.02) < WITHIN_S


@pytest.mark.parametrize(("skew_s", "configured_s"), [(0.06, 0.0), (0.004, 0.0), (0.06, 0.06)])
def test_solve_tells_the_offset_and_what_to_set(tmp_path, skew_s, configured_s):
    cell = Simulation(5, arm=ARM)
    taught = cell.record(wrists=[cell.wrist() for _ in range(6)])
    made = jogged_pictures(cell, Jog(skew_s, moves=8, reading_hz=25.0))
    with SessionWriter(tmp_path, "s", Plan.JOINT, cell.facts(), SystemClock()) as writer:
        for kind, samples in (
            (SampleKind.LOOK, taught.looks),
            (SampleKind.SPIN, taught.spins),
            (SampleKind.TOUCH, taught.touches),
        ):
            for sample in samples:
                writer.sample(kind, sample)
        for stamp_s, pose in zip(made.stamps_s, made.poses, strict=True):
            writer.flange(FlangeReading(pose, None, stamp_s, stamp_s))
        for sight in made.moving:
            writer.moving(replace(sight, delay_s=configured_s))
    result = solve_session(writer.path)
    told = [f for f in result["verdict"]["findings"] if f["code"] == "picture_delay"]
    offset = result["time_offset"]
    assert offset["delay_ms"] == pytest.approx(1e3 * skew_s, abs=3)
    assert offset["offset_ms"] == pytest.approx(1e3 * (skew_s - configured_s), abs=3)
    if skew_s - configured_s > 0.01:
        assert "ms after the pose of their time" in told[0]["message"]
        assert f"delay_ms = {offset['delay_ms']:.0f}" in told[0]["message"]
        assert not told[0]["fatal"]
    else:
        assert not told


def test_a_session_without_moving_pictures_tells_nothing(tmp_path):
    cell = Simulation(5, arm=ARM)
    taught = cell.record(wrists=[cell.wrist() for _ in range(6)])
    with SessionWriter(tmp_path, "s", Plan.JOINT, cell.facts(), SystemClock()) as writer:
        for sample in taught.looks:
            writer.sample(SampleKind.LOOK, sample)
        for sample in taught.spins:
            writer.sample(SampleKind.SPIN, sample)
        for sample in taught.touches:
            writer.sample(SampleKind.TOUCH, sample)
    assert "no pictures of the moving arm" in solve_session(writer.path)["time_offset"]["unknown"]
