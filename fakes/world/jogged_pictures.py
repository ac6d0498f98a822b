"""Pictures of an arm that is jogged, whose stamps and those of the poses are of two clocks.

Drawn from the moves of the fake arm and the tags of the simulation; shares no code with what finds
the time between the clocks.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fakes.world.arm import Arm
from fakes.world.simulation import Simulation
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import MovingSight, Observation, TagObservation

_EDGE = 0.5 * np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
_VOLUME_MM = 100.0  # either way, as the looks of the simulation
_TURNS_RAD = (0.4, 0.4, 0.8)  # idem
_SETTLED_S = 0.15  # after a move no picture counts as at rest: it may be late by that


@dataclass(frozen=True, slots=True)
class Jog:
    """How it is jogged and photographed.

    skew_s: a picture shows the arm so much after its stamp. jitter_s: of a picture's stamp;
    reading_jitter_s: of a pose's. roll_s: from the first row of a picture to the last. span: of the
    volume, 0 for an arm that only turns about its flange.
    """

    skew_s: float = 0.0
    jitter_s: float = 0.0
    reading_jitter_s: float = 0.0
    roll_s: float = 0.0
    moves: int = 30  # some two minutes
    speed_mm_s: float = 80.0  # a guess: operators jog at a third of what is allowed
    picture_hz: float = 2.0  # as the cell file's default
    reading_hz: float = 125.0  # as a UR
    span: float = 1.0


@dataclass(slots=True)
class JoggedPictures:
    """stamps_s and poses of the flange; pictures of the moving arm, and of the arm at rest."""

    stamps_s: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    moving: list[MovingSight] = field(default_factory=list)
    rests: list[Observation] = field(default_factory=list)


def jogged_pictures(cell: Simulation, jog: Jog) -> JoggedPictures:
    """Jog the arm from place to place with a pause at each."""
    rng, made = cell.rng, JoggedPictures()
    arm = Arm(cell.standing, Pose.identity(), seed=0, speed_mm_s=jog.speed_mm_s, speed_rad_s=0.5)
    times_s = _exposures(rng, jog)
    exposed_s, now_s = next(times_s), 0.0
    reading_s = 1.0 / jog.reading_hz
    for _ in range(jog.moves):
        begin_s = now_s
        arrived_s = arm.move_flange(_place(rng, cell, jog), now_s)
        now_s = arrived_s + float(rng.uniform(0.8, 2.0))
        for k in range(int((now_s - begin_s) / reading_s)):
            told_s = begin_s + k * reading_s
            made.stamps_s.append(told_s + float(rng.normal()) * jog.reading_jitter_s)
            made.poses.append(arm.reported_flange(told_s))
        while exposed_s < now_s:
            is_moving = begin_s < exposed_s < arrived_s
            if is_moving or arrived_s + _SETTLED_S < exposed_s:
                _take(cell, arm, jog, exposed_s, made, is_moving=is_moving)
            exposed_s = next(times_s)
    return made


def _exposures(rng: np.random.Generator, jog: Jog) -> Iterator[float]:
    """When pictures are taken, s; a camera keeps no phase with the robot."""
    now_s = 1.0
    while True:
        yield now_s
        now_s += float(rng.uniform(0.9, 1.1)) / jog.picture_hz


def _place(rng: np.random.Generator, cell: Simulation, jog: Jog) -> Pose:
    turn = rng.uniform(-1, 1, 3) * _TURNS_RAD
    shift = rng.uniform(-1, 1, 3) * _VOLUME_MM * jog.span
    R = cell.standing.rotation @ exp_rotation(turn * min(jog.span, 1.0))
    return Pose(R, cell.standing.translation + shift)


def _take(
    cell: Simulation,
    arm: Arm,
    jog: Jog,
    exposed_s: float,
    made: JoggedPictures,
    *,
    is_moving: bool,
) -> None:
    height = cell.facts().image_size_px[1]
    seen = cell.observe(arm.reported_flange(exposed_s), 0.0)
    if jog.roll_s and seen.tag_a is not None:
        row = _corners(cell, seen.tag_a)[:, 1].mean() / height - 0.5
        seen = cell.observe(arm.reported_flange(exposed_s + jog.roll_s * row), 0.0)
    if seen.tag_a is None:
        return
    stamp_s = exposed_s - jog.skew_s + float(cell.rng.normal()) * jog.jitter_s
    tag_a = replace(seen.tag_a, corners_px=_corners(cell, seen.tag_a))
    told = arm.reported_flange(stamp_s)
    if is_moving:
        made.moving.append(MovingSight(told, stamp_s, tag_a, seen.tag_b))
    else:
        made.rests.append(Observation(arm.reported_flange(exposed_s), stamp_s, tag_a, seen.tag_b))


def _corners(cell: Simulation, tag: TagObservation) -> Array:
    """Where the camera sees them, (4, 2) px."""
    rays = (tag.camera_from_tag @ (tag.tag.size_mm * _EDGE)) @ np.asarray(
        cell.facts().camera_matrix
    ).T
    return np.asarray(rays[:, :2] / rays[:, 2:])
