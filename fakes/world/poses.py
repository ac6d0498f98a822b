"""The poses of the scripted operator: where looks, touches, the spike and requests happen.

All poses are `base_from_wrist`, seeded, and picked so that the tags can be read where that is the
point.
"""

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from fakes.world.layout import FIXED_POINT, Layout
from fakes.world.visibility import TAG_NAMES, visible
from fakes.world.world import WorldSnapshot
from vgrd.geometry import Array, Pose, exp_rotation, log_rotation

_T = TypeVar("_T")
WORK_ROTATION = np.diag([1.0, -1.0, -1.0])  # the tool points straight down
_FREE_WRIST = 6  # axes of an arm whose wrist turns about any axis
_LEAST_TILT_RAD = np.radians(12)  # below it a tag's pose is ambiguous (a guess)
_MOST_TILT_RAD = np.radians(65)  # short of where a tag is not found (_STEEPEST_RAD)


def frozen_snapshot(base_from_wrist: Pose, angle_rad: float = 0.0) -> WorldSnapshot:
    """Make the snapshot of a perfect arm at a pose."""
    return WorldSnapshot(tuple(base_from_wrist.matrix().ravel().tolist()), angle_rad)


def readable(layout: Layout, base_from_wrist: Pose, angle_rad: float = 0.0) -> dict[str, bool]:
    """Tell for each tag whether it is seen under a tilt at which its pose is unambiguous."""
    snapshot = frozen_snapshot(base_from_wrist, angle_rad)
    sights = {name: visible(layout, name, snapshot) for name in TAG_NAMES}
    return {
        name: sight.seen and _LEAST_TILT_RAD <= sight.tilt_rad <= _MOST_TILT_RAD
        for name, sight in sights.items()
    }


def retracted_pose(layout: Layout | None = None) -> Pose:
    """Stand aside with the work orientation: both tags in view at every table angle.

    layout: None for the default one.
    """
    return Pose(WORK_ROTATION, (layout or Layout()).aside_mm)


def touch_pose(
    layout: Layout, target: str, angle_rad: float = 0.0, tilt: Array | None = None
) -> Pose:
    """Put the true tip onto a target (or `FIXED_POINT`).

    tilt: rotation vector (3,) in base axes by which the wrist deviates from straight down.
    """
    rotation = WORK_ROTATION if tilt is None else exp_rotation(tilt) @ WORK_ROTATION
    tip = layout.target_in_base(target, angle_rad)
    return Pose(rotation, tip - rotation @ layout.tcp_in_wrist)


def look_poses(layout: Layout, n: int, *, seed: int = 0) -> list[Pose]:
    """List `n` poses for hand-eye looks: turned by 20 to 30 deg, moved by up to 60 mm, both tags seen."""
    poses = (Pose(exp_rotation(t) @ WORK_ROTATION, p) for t, p in _look_candidates(layout, seed))
    return _first(n, poses, lambda pose: all(readable(layout, pose).values()))


def _look_candidates(layout: Layout, seed: int) -> Iterator[tuple[Array, Array]]:
    """Draw tilts (3,) rad and flange positions (3,) mm without end, readable or not."""
    rng = np.random.default_rng((seed, 11))
    middle, reach = layout.looks_around_mm
    while True:
        tilt = _possible(layout, _direction(rng)) * np.radians(rng.uniform(20, 30))
        yield tilt, middle + rng.uniform(-1, 1, 3) * reach


def tilt_candidates(layout: Layout, seed: int, low_deg: float, high_deg: float) -> Iterator[Array]:
    """Draw wrist deviations (3,) rad, lean and yaw, of a size in degrees, without end."""
    rng = np.random.default_rng((seed, 12))
    while True:
        lean = rng.uniform(0, 2 * np.pi)
        axis = np.array([np.cos(lean), np.sin(lean), rng.uniform(-0.5, 0.5)])
        axis = _possible(layout, axis)
        yield axis / np.linalg.norm(axis) * np.radians(rng.uniform(low_deg, high_deg))


def _possible(layout: Layout, axis: Array) -> Array:
    """The axis (3,) about which the wrist turns: an arm of four axes has the vertical one only."""
    return axis if layout.arm_axes == _FREE_WRIST else np.array([0.0, 0.0, np.sign(axis[2])])


def touch_tilts(layout: Layout, targets: list[str], *, seed: int = 0) -> list[Array]:
    """Pick for each target a wrist deviation of 15 to 25 deg under which both tags are seen.

    Where the layout asks for it the wrist is turned about the tool besides, one way and the other; then
    tag B is.
    """
    needed = ("b",) if layout.touch_turn_rad else TAG_NAMES
    return [
        _first(
            1,
            _turned(tilt_candidates(layout, seed + i, 15, 25), (-1) ** i * layout.touch_turn_rad),
            lambda tilt, name=target: all(  # type: ignore[misc]
                readable(layout, touch_pose(layout, name, 0.0, tilt))[tag] for tag in needed
            ),
        )[0]
        for i, target in enumerate(targets)
    ]


def _turned(tilts: Iterator[Array], turn_rad: float) -> Iterator[Array]:
    """Wrist deviations (3,) rad with a turn about the tool before each."""
    if not turn_rad:
        return tilts
    turn = exp_rotation(np.array([0.0, 0.0, turn_rad]))
    return (log_rotation(exp_rotation(tilt) @ turn) for tilt in tilts)


def fixed_point_poses(layout: Layout, n: int, *, seed: int = 0) -> list[Pose]:
    """List `n` poses with the true tip on the spike, wrists turned by 15 to 40 deg, tag A seen."""
    poses = (
        touch_pose(layout, FIXED_POINT, 0.0, t) for t in tilt_candidates(layout, seed, 15, 40)
    )
    return _first(n, poses, lambda pose: readable(layout, pose)["a"])


def _first(n: int, candidates: Iterator[_T], accept: Callable[[_T], bool]) -> list[_T]:
    """Take the first `n` acceptable candidates; gives up after 200 per pose."""
    chosen: list[_T] = []
    for _, candidate in zip(range(200 * n), candidates, strict=False):
        if accept(candidate):
            chosen.append(candidate)
        if len(chosen) == n:
            return chosen
    raise LookupError(f"only {len(chosen)} of {n} poses are readable: check the layout")


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))
