"""Rules: what happens to object, tags, camera and arm."""

import numpy as np

from tests.invariant.rig import Rig
from tests.invariant.rules.table import SEEDS, Among, Between, rule
from tests.invariant.simulation.plant import STILL
from vgrd.geometry import Array, Pose
from vgrd.model import Motion

SIZES_MM = Among((0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0))
MRAD_PER_MM = 2.0
TARGETS = Among(("P1", "P2", "P3", "P4", "P5", "P6"))
PLANE = np.array([1, 1, 0, 0, 0, 1.0])


def _pose(size_mm: float, seed: int, axes: Array | float = 1.0) -> Pose:
    """A shift of a size in a random direction, and a turn by some mrad for each mm."""
    tangent = np.random.default_rng(seed).normal(size=6) * axes
    tangent[:3] *= size_mm / max(float(np.linalg.norm(tangent[:3])), 1e-9)
    tangent[3:] *= 1e-3 * MRAD_PER_MM * size_mm / max(float(np.linalg.norm(tangent[3:])), 1e-9)
    return Pose.exp(tangent)


@rule("C3", weight=3, angle_rad=Between(-3.0, 3.0))
def table_turned(rig: Rig, angle_rad: float) -> None:
    rig.plant.turn(angle_rad, rig.clock.now_s)


@rule("S2 C3", weight=2, angle_rad=Among((-0.02, 0.001, 0.003, 0.005, 0.01, 0.35)))
def table_nudged(rig: Rig, angle_rad: float) -> None:
    """A little, from where it is."""
    at = rig.plant.placements[-1].angle(rig.clock.now_s)
    rig.plant.turn(at + angle_rad, rig.clock.now_s)


@rule("C3", weight=2, angle_rad=Between(-3.0, 3.0), size_mm=Between(0.1, 30.0), seed=SEEDS)
def object_jerked(rig: Rig, angle_rad: float, size_mm: float, seed: int) -> None:
    """Put elsewhere in no time, as its motion allows: a machine that slept while people worked."""
    axes = {Motion.TURNTABLE: 0.0, Motion.PLANAR: PLANE, Motion.FREE: 1.0}[rig.motion]
    offset = STILL if rig.motion is Motion.TURNTABLE else _pose(size_mm, seed, axes)
    rig.plant.jerk(angle_rad, rig.clock.now_s, offset)


@rule("C3", weight=2, angle_rad=Among((0.01, 0.3)), pause_s=Between(0.0, 0.6), seed=SEEDS)
def turned_while_it_is_answered(rig: Rig, angle_rad: float, pause_s: float, seed: int) -> None:
    """Between request, picture and reading."""
    rig.ask_any(seed)
    rig.wait(pause_s)
    at = rig.plant.placements[-1].angle(rig.clock.now_s)
    rig.plant.jerk(at + angle_rad, rig.clock.now_s, rig.plant.placements[-1].offset)


@rule("S1", size_mm=SIZES_MM, seed=SEEDS)
def object_lifted(rig: Rig, size_mm: float, seed: int) -> None:
    """Off its motion; an object that may lie anywhere has none."""
    if rig.motion is not Motion.FREE:
        rig.plant.lift(_pose(size_mm, seed), rig.clock.now_s)


@rule("S1 F23", size_mm=SIZES_MM, seed=SEEDS)
def tag_b_slipped(rig: Rig, size_mm: float, seed: int) -> None:
    rig.plant.tag_b_slip = _pose(size_mm, seed)


@rule("F23", size_mm=SIZES_MM, seed=SEEDS)
def tag_a_slipped(rig: Rig, size_mm: float, seed: int) -> None:
    rig.plant.tag_a_slip = _pose(size_mm, seed)


@rule("S6", size_mm=SIZES_MM, seed=SEEDS)
def camera_moved(rig: Rig, size_mm: float, seed: int) -> None:
    rig.plant.camera_shift = _pose(size_mm, seed)


@rule("F10 F11 F12", factor=Among((0.99, 1.002, 1.05)))
def camera_swapped(rig: Rig, factor: float) -> None:
    """For one with another lens: it sees depths in another scale."""
    rig.plant.lens = factor


@rule("F24 F26", tag=Among(("a", "b")), size_mm=Among((1.0, 30.0)), seed=SEEDS)
def outlier(rig: Rig, tag: str, size_mm: float, seed: int) -> None:
    """One picture in which a tag is found where it is not."""
    rig.daemon.camera.film.outlier = (tag, _pose(size_mm, seed))


@rule("F21 F22 F25", weight=2, tags=Among(("a", "b", "ab")))
def tags_hidden(rig: Rig, tags: str) -> None:
    """Covered, cut by glare, swapped for one of another id, or there twice: not found, in all cases."""
    rig.plant.covered = set(tags)


@rule(weight=2)
def tags_free(rig: Rig) -> None:
    rig.plant.covered = set()


@rule("F9")
def light_switched(rig: Rig) -> None:
    rig.plant.is_dark = not rig.plant.is_dark


@rule("F19", weight=2, above=TARGETS)
def arm_approaches(rig: Rig, above: str) -> None:
    """On its way to a target it hides tag B in the end."""
    rig.plant.approach(above, rig.clock.now_s)


@rule("F19", weight=2, seed=SEEDS)
def arm_moves(rig: Rig, seed: int) -> None:
    rig.plant.wander(seed, rig.clock.now_s)


@rule("S2 C3", above=TARGETS, angle_rad=Among((0.0, 0.05)), seed=SEEDS)
def tag_hidden_by_the_arm(rig: Rig, above: str, angle_rad: float, seed: int) -> None:
    """On its last way, and perhaps the object moves just then."""
    rig.ask_any(seed)
    rig.wait(1.0)
    rig.plant.approach(above, rig.clock.now_s)
    rig.wait(0.5)
    rig.plant.covered = {"b"}
    rig.wait(0.3)
    if angle_rad:
        rig.plant.turn(
            rig.plant.placements[-1].angle(rig.clock.now_s) + angle_rad, rig.clock.now_s
        )


@rule("F20 C15", weight=0.5, size_mm=Among((0.02, 1.0, 50.0)))
def tcp_changed(rig: Rig, size_mm: float) -> None:
    """On the pendant."""
    rig.change_tcp(size_mm)


@rule("C15")
def tcp_restored(rig: Rig) -> None:
    """And nobody confirms it: what was latched stays, also in another life of the cell."""
    rig.restore_tcp()


@rule(weight=20)
def repair(rig: Rig) -> None:
    """Somebody puts everything right and confirms it."""
    rig.repair()
