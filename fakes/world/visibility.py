"""What the fake camera can see: field of view, tilt, focus, and what stands in the way.

The bodies that hide things are chains of spheres: tool, flange and wrist, bracket, forearm.
"""

from dataclasses import dataclass

import numpy as np

from fakes.world.layout import FLANGE_RADIUS_MM, TOOL_RADIUS_MM, Layout
from fakes.world.world import TagName, WorldSnapshot
from vgrd.geometry import Array, Pose

TAG_NAMES: tuple[TagName, TagName] = ("a", "b")
PLATE_CELLS = 10  # printed square of 8 cells and a white border of one cell around it
_STEEPEST_RAD = np.radians(75)  # a guess: beyond 70, where the coach stops (_INCIDENCE)
_BLURRED_PX = 12.0  # a guess: a third of a tag's cell (34 px)
_ELBOW_IN_BASE = np.array([60.0, 0.0, 640.0])  # above the foot, as the arm stands in the drawing
_SPHERES = 25  # along a body: nearer to each other than they are thick


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A tapered capsule in the base frame: ends (2, 3) and radii (2,), mm."""

    name: str
    ends: Array
    radii: Array

    def spheres(self) -> tuple[Array, Array]:
        """Centres (n, 3) and radii (n,) of spheres along the axis."""
        share = np.linspace(0, 1, _SPHERES)
        return (
            self.ends[0] + share[:, None] * (self.ends[1] - self.ends[0]),
            self.radii[0] + share * (self.radii[1] - self.radii[0]),
        )


def bodies(layout: Layout, base_from_wrist: Pose) -> list[Body]:
    """List the parts of the arm that can hide a tag, far ones first as the camera sees them."""
    tip = layout.tcp_in_wrist
    plate = layout.wrist_from_tag_a
    behind_plate = plate.apply((0.0, 0.0, 6.0))
    in_wrist = [
        ("wrist", (0.0, 0.0, -FLANGE_RADIUS_MM), (0.0, 0.0, -95.0), FLANGE_RADIUS_MM, 38.0),
        ("bracket", (18.0, 0.0, 4.0), behind_plate, 5.0, 5.0),
        ("tool", (0.0, 0.0, 4.0), tip * 0.8, 1.6 * TOOL_RADIUS_MM, TOOL_RADIUS_MM),
        ("tip", tip * 0.8, tip, TOOL_RADIUS_MM, 0.4),
    ]
    parts = [
        Body(name, base_from_wrist.apply(np.array([start, end])), np.array([r0, r1]))
        for name, start, end, r0, r1 in in_wrist
    ]
    wrist_end = base_from_wrist.apply((0.0, 0.0, -95.0))
    forearm = Body("forearm", np.array([wrist_end, _ELBOW_IN_BASE]), np.array([38.0, 48.0]))
    return [forearm, *parts]


def plate_points(size_mm: float, cells: float = PLATE_CELLS, n: int = 2) -> Array:
    """Grid (n * n, 3) over a square of `cells` cells around a tag of 8 cells, tag frame, mm."""
    line = np.linspace(-0.5, 0.5, n) * size_mm * cells / 8
    x, y = np.meshgrid(line, line)
    return np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], -1)


def hides(body: Body, points_in_base: Array, eye_in_base: Array) -> bool:
    """Tell whether a body cuts a line of sight from any of the points (n, 3) to the camera."""
    centres, radii = body.spheres()
    way = eye_in_base - points_in_base
    to_centre = centres[None] - points_in_base[:, None]
    share = np.einsum("pbk,pk->pb", to_centre, way) / (way**2).sum(1)[:, None]
    nearest = points_in_base[:, None] + np.clip(share, 0, 1)[..., None] * way[:, None]
    gap = np.linalg.norm(centres[None] - nearest, axis=2) - radii
    return bool((gap < 0).any())


def plate_hides(base_from_plate: Pose, size_mm: float, points_in_base: Array, eye: Array) -> bool:
    """Tell whether a tag's plate cuts a line of sight from any of the points (n, 3) to the camera."""
    plate_from_base = base_from_plate.inverse()
    start, end = plate_from_base.apply(points_in_base), plate_from_base.apply(eye)
    crosses = start[:, 2] * end[2] < 0
    share = start[:, 2:] / np.where(crosses, start[:, 2] - end[2], 1.0)[:, None]
    crossings = start + share * (end - start)
    is_on_plate = (np.abs(crossings[:, :2]) < size_mm * PLATE_CELLS / 16).all(1)
    return bool((crosses & is_on_plate).any())


@dataclass(frozen=True, slots=True)
class Visibility:
    """How the camera sees a tag: `reasons` why it cannot be read (empty: it can), tilt, focus, depth.

    tilt_rad: between the tag's normal and the line of sight; defocus_px: diameter of the blur
    disc.
    """

    reasons: tuple[str, ...]
    tilt_rad: float
    defocus_px: float
    depth_mm: float

    @property
    def seen(self) -> bool:
        """True when nothing keeps the tag from being read."""
        return not self.reasons


def visible(layout: Layout, name: TagName, snapshot: WorldSnapshot) -> Visibility:
    """Judge how the camera sees tag "a" or "b" in a snapshot."""
    tag = layout.tag_a if name == "a" else layout.tag_b
    base_from_tag = snapshot.base_from_tag(name, layout)
    camera_from_tag = layout.base_from_camera.inverse().compose(base_from_tag)
    centre = camera_from_tag.translation
    cosine = float(camera_from_tag.rotation[:, 2] @ centre / np.linalg.norm(centre))
    tilt = float(np.arccos(np.clip(cosine, -1, 1)))
    defocus = layout.optics.defocus_px(float(centre[2]))
    reasons = []
    if name in snapshot.covered:
        reasons.append("covered")
    if not snapshot.lights:
        reasons.append("dark")
    if tilt > _STEEPEST_RAD:
        reasons.append("turned away")
    elif not _inside(layout, camera_from_tag.apply(plate_points(tag.size_mm))):
        reasons.append("out of view")
    if defocus > _BLURRED_PX:
        reasons.append("out of focus")
    points = base_from_tag.apply(plate_points(tag.size_mm, n=7))
    eye = layout.base_from_camera.translation
    reasons += [
        f"behind {body.name}"
        for body in bodies(layout, snapshot.base_from_wrist)
        if hides(body, points, eye)
    ]
    tag_a = snapshot.base_from_tag("a", layout)
    if name == "b" and plate_hides(tag_a, layout.tag_a.size_mm, points, eye):
        reasons.append("behind tag a")
    return Visibility(tuple(reasons), tilt, defocus, float(centre[2]))


def _inside(layout: Layout, points_in_camera: Array) -> bool:
    pixels = layout.optics.project(points_in_camera)
    return bool(((pixels >= 0) & (pixels <= np.array(layout.optics.size_px) - 1)).all())
