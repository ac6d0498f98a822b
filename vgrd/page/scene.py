"""The cell as a drawing: flange with tool, camera, tags, targets, axis, and where the flange shall go.

SVG, projected here: it needs no graphics card in a tablet, and prints. Pure.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vgrd.geometry import Array, Pose
from vgrd.page import texts

_WIDTH, _HEIGHT, _MARGIN = 800.0, 520.0, 60.0  # of the drawing
_RISE = np.radians(25.0)  # of the view above the floor: heights and places both show
_LEAST_MM = 300.0  # that the drawing is wide: a lone flange fills no page
_FLANGE_MM, _CAMERA_MM, _AXIS_MM, _TOOL_MM = 32.0, 60.0, 120.0, 100.0  # sizes of what is drawn
_SIDES = 24  # of a circle
_NEAR_MM, _NEAR_DEG = 1.0, 0.5  # so near a pose is reached: hands do not jog finer
_ALONG = np.array([[0.0, 0, -_AXIS_MM], [0, 0, _AXIS_MM]])  # the axis of turning, up and down
_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
_TURNED = np.linspace(0.2, 1.7, 13)  # rad: of the arrow that says "turn the object"

Reply = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Shape:
    """Points (n, 3) in the base, mm; kind: a class of `page.css`; label: beside the first point."""

    kind: str
    points: Array
    closed: bool = False
    label: str = ""


def project(points: Array, azimuth_deg: float) -> Array:
    """(n, 2), right and up, of points (n, 3), looked at from a turn about z of the base.

    Parallel, so that equal lengths which point alike stay equal.
    """
    turn = np.radians(azimuth_deg)
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    ahead = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.sin(_RISE) * ahead + np.cos(_RISE) * np.array([0.0, 0.0, 1.0])
    flat: Array = np.asarray(points) @ np.stack([right, up], axis=1)
    return flat


def drawing(scene: Reply, step: Reply, azimuth_deg: float) -> str:
    """SVG of a reply of `scene`, with what the step of `teaching` asks for."""
    shapes = [*_cell(scene), *_task(scene, step)]
    flat = [project(shape.points, azimuth_deg) for shape in shapes]
    every = np.vstack(flat or [np.zeros((1, 2))])
    low, high = every.min(axis=0), every.max(axis=0)
    middle, size = (low + high) / 2, np.maximum(high - low, _LEAST_MM)
    scale = float(min((_WIDTH - 2 * _MARGIN) / size[0], (_HEIGHT - 2 * _MARGIN) / size[1]))
    center = np.array([_WIDTH, _HEIGHT]) / 2
    parts = []
    for shape, points in zip(shapes, flat, strict=True):
        placed = center + (points - middle) * scale * np.array([1.0, -1.0])
        parts.append(_element(shape, placed))
    return (
        f'<svg class="scene" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" role="img" '
        f'aria-label="{escape(texts.SCENE)}"><defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" '
        'markerWidth="5" markerHeight="5" orient="auto"><path d="M0 0L8 4L0 8z" class="head"/></marker></defs>'
        f"{_axes(azimuth_deg)}{''.join(parts)}</svg>"
    )


def _axes(azimuth_deg: float) -> str:
    """Directions of the base, in the corner: the base itself may stand far off."""
    corner = np.array([_MARGIN, _HEIGHT - _MARGIN])
    ends = corner + project(np.eye(3), azimuth_deg) * _MARGIN * 0.7 * np.array([1.0, -1.0])
    return "".join(
        _element(Shape("base", np.zeros(0), label=name), np.vstack([end, corner]))
        for end, name in zip(ends, "xyz", strict=True)
    )


def _cell(scene: Reply) -> Iterable[Shape]:
    """What stands there now."""
    if axis := scene.get("axis"):
        yield Shape("axis", _moved(axis, _ALONG))
    for name in ("tag_a", "tag_b"):
        if rows := scene.get(name):
            half = _CORNERS * scene["tag_mm"][name[-1]]
            corners = np.column_stack([half, np.zeros(4)])
            label = texts.TAG.format(name=name[-1].upper())
            yield Shape("tag", _moved(rows, corners), closed=True, label=label)
    if rows := scene.get("camera"):
        yield from _camera(rows)
    for name, point in (scene.get("targets") or {}).items():
        yield Shape("target", np.array([point], float), label=str(name))
    if rows := scene.get("flange"):
        yield from _flange(rows, scene.get("tip_in_wrist"), "flange", texts.FLANGE)


def _task(scene: Reply, step: Reply) -> Iterable[Shape]:
    """Where to go, or what to turn."""
    if step.get("flange_mm") is not None:
        rotvec = np.radians(step["rotvec_deg"])
        goal = Pose.from_rotvec(rotvec, step["flange_mm"])
        yield from _flange(goal.matrix(), scene.get("tip_in_wrist"), "goal", texts.GOAL)
        if now := scene.get("flange"):
            way = np.vstack([Pose.from_matrix(now).translation, goal.translation])
            yield Shape("way", way)
    elif target := (scene.get("targets") or {}).get(step.get("target")):
        yield Shape("aim", np.array([target], float), label=str(step["target"]))
    if step.get("kind") in ("spin", "verify") and scene.get("axis"):
        ring = np.column_stack([np.cos(_TURNED), np.sin(_TURNED), np.zeros(len(_TURNED))])
        yield Shape("way", _moved(scene["axis"], _AXIS_MM * ring), label=texts.TURN)


def _flange(
    rows: ArrayLike, tip: Sequence[float] | None, kind: str, label: str
) -> Iterable[Shape]:
    """A disk, a mark at its x, and the tool."""
    turn = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    ring = _FLANGE_MM * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])
    yield Shape(kind, _moved(rows, ring), closed=True, label=label)
    yield Shape(kind, _moved(rows, np.array([[0.0, 0, 0], [_FLANGE_MM, 0, 0]])))
    end = [0.0, 0.0, _TOOL_MM] if tip is None else tip
    yield Shape(kind if tip else "axis", _moved(rows, np.array([[0.0, 0, 0], end])))


def _camera(rows: ArrayLike) -> Iterable[Shape]:
    """A pyramid that opens to where it looks."""
    front = np.column_stack([_CORNERS * (1.3, 1.0), np.ones(4)]) * _CAMERA_MM
    yield Shape("camera", _moved(rows, front), closed=True)
    for i, corner in enumerate(front):
        label = texts.CAMERA if i == 0 else ""
        yield Shape("camera", _moved(rows, np.array([[0.0, 0, 0], corner])), label=label)


def _moved(rows: ArrayLike, points: Array) -> Array:
    M = np.asarray(rows, dtype=np.float64)
    moved: Array = points @ M[:3, :3].T + M[:3, 3]
    return moved


def _element(shape: Shape, placed: Array) -> str:
    """One shape of SVG, with its label."""
    points = " ".join(f"{x:.0f},{y:.0f}" for x, y in placed)
    x, y = placed[0]
    drawn = ""
    if len(placed) == 1:
        drawn = f'<circle class="{shape.kind}" cx="{x:.0f}" cy="{y:.0f}" r="6"/>'
    elif len(placed) > 1:
        name = "polygon" if shape.closed else "polyline"
        head = ' marker-end="url(#head)"' if shape.kind == "way" else ""
        drawn = f'<{name} class="{shape.kind}" points="{points}"{head}/>'
    if not shape.label:
        return drawn
    return f'{drawn}<text class="{shape.kind}" x="{x + 9:.0f}" y="{y - 7:.0f}">{escape(shape.label)}</text>'


def move_in_words(scene: Reply, step: Reply) -> str:
    """How far the flange is from where it shall go, and how to turn it; "" where nothing is known."""
    if step.get("flange_mm") is None or not scene.get("flange"):
        return ""
    now = Pose.from_matrix(scene["flange"])
    goal = Pose.from_rotvec(np.radians(step["rotvec_deg"]), step["flange_mm"])
    way = goal.translation - now.translation
    turn = np.degrees(Pose(goal.rotation @ now.rotation.T, np.zeros(3)).rotvec())
    angle = float(np.linalg.norm(turn))
    if np.linalg.norm(way) < _NEAR_MM and angle < _NEAR_DEG:
        return texts.REACHED
    words = texts.MOVE.format(*way)
    if angle >= _NEAR_DEG:
        words += texts.TURN_BY.format(angle, *(turn / angle))
    return words
