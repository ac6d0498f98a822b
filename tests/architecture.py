"""Draws docs/architecture.svg from the imports: `python -m tests.architecture docs/architecture.svg`.

A room is a file or folder, its floor is one above the highest that it imports, an arrow is an import
that no other path of arrows tells.
"""

import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

import grimp

HOUSES = (  # what is drawn, row by row: packages, whose children are the rooms
    ("vgrd", "vgrd.calibration"),
    ("fakes", "vgrd.vision", "vgrd.cell"),
)
ROOM_PX, FLOOR_PX, GAP_PX, LETTER_PX, TITLE_PX = 26, 62, 16, 7.4, 36
HOUSE_GAP_PX = 60
Arrows = Mapping[str, frozenset[str]]


class Box(NamedTuple):
    """Where a room is drawn, px."""

    x: float
    y: float
    width: float


def arrows_of(house: str, graph: grimp.ImportGraph) -> dict[str, frozenset[str]]:
    """Rooms of a package, each with those that it imports; a package's own door is no room."""
    rooms = sorted(
        room
        for room in graph.find_children(house)
        if not room.endswith("__main__") and (graph.find_children(room) or _imports(graph, room))
    )
    inside = {room: frozenset((room, *graph.find_descendants(room))) for room in rooms}
    return {
        room: frozenset(
            other
            for other in rooms
            if other != room
            and any(inside[other] & _imports(graph, module) for module in inside[room])
        )
        for room in rooms
    }


def _imports(graph: grimp.ImportGraph, module: str) -> frozenset[str]:
    return frozenset(
        name for name in graph.find_modules_directly_imported_by(module) if name != module
    )


def floors_of(arrows: Arrows) -> dict[str, int]:
    """Floor of each room, 0 for the ground; raises ValueError naming a circle."""
    path: list[str] = []

    @cache
    def floor(room: str) -> int:
        if room in path:
            raise ValueError(f"circle of imports: {' -> '.join((*path, room))}")
        path.append(room)
        height = 1 + max((floor(other) for other in arrows[room]), default=-1)
        path.pop()
        return height

    return {room: floor(room) for room in arrows}


def reduced(arrows: Arrows) -> Iterator[tuple[str, str]]:
    """Arrows without those that a longer path tells too."""

    @cache
    def reach(room: str) -> frozenset[str]:
        return arrows[room].union(*(reach(other) for other in arrows[room]))

    for room, others in arrows.items():
        for other in others:
            if not any(other in reach(between) for between in others - {other}):
                yield room, other


def _placed(arrows: Arrows, left: float, top: float) -> tuple[dict[str, Box], float]:
    """Box of each room, the ground floor lowest and every floor centred; width of the house."""
    floors = floors_of(arrows)
    highest = max(floors.values())
    widths = {room: LETTER_PX * len(_short(room)) + 18 for room in arrows}
    rows = [sorted(room for room in arrows if floors[room] == f) for f in range(highest + 1)]
    lengths = [sum(widths[room] + GAP_PX for room in row) - GAP_PX for row in rows]
    boxes: dict[str, Box] = {}
    for floor, (row, length) in enumerate(zip(rows, lengths, strict=True)):
        x = left + (max(lengths) - length) / 2
        for room in row:
            boxes[room] = Box(x, top + (highest - floor) * FLOOR_PX, widths[room])
            x += widths[room] + GAP_PX
    return boxes, max(lengths)


def _short(room: str) -> str:
    return room.rpartition(".")[2]


def _house(name: str, arrows: Arrows, left: float, top: float) -> tuple[list[str], float, float]:
    """SVG of one house, its width and height."""
    boxes, width = _placed(arrows, left, top + TITLE_PX)
    title = escape(name.replace(".", "/"))
    lines = [f'<text x="{left:.0f}" y="{top + 18:.0f}" class="title">{title}</text>']
    lines += [_arrow(boxes[room], boxes[other]) for room, other in sorted(reduced(arrows))]
    for room, box in sorted(boxes.items()):
        lines.append(
            f'<rect x="{box.x:.0f}" y="{box.y:.0f}" width="{box.width:.0f}" height="{ROOM_PX}" '
            f'rx="4"/><text x="{box.x + 9:.0f}" y="{box.y + 17:.0f}">{escape(_short(room))}</text>'
        )
    height = TITLE_PX + (max(floors_of(arrows).values()) + 1) * FLOOR_PX
    return lines, width, height


def _arrow(room: Box, other: Box) -> str:
    x1, y1 = room.x + room.width / 2, room.y + ROOM_PX
    x2, y2 = other.x + other.width / 2, other.y
    bend = (y2 - y1) / 2
    return (
        f'<path d="M{x1:.0f},{y1:.0f} C{x1:.0f},{y1 + bend:.0f} '
        f'{x2:.0f},{y2 - bend:.0f} {x2:.0f},{y2:.0f}"/>'
    )


def drawing() -> str:
    """The whole picture as SVG."""
    graph = grimp.build_graph("vgrd", "drivers", "fakes", cache_dir=None)
    lines: list[str] = []
    top, widest = 10.0, 0.0
    for row in HOUSES:
        left, highest = 20.0, 0.0
        for house in row:
            drawn, width, height = _house(house, arrows_of(house, graph), left, top)
            lines += drawn
            left += width + HOUSE_GAP_PX
            highest = max(highest, height)
        top += highest
        widest = max(widest, left)
    return HEAD.format(width=widest - 40, height=top) + "\n".join(lines) + "\n</svg>\n"


HEAD = """\
<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" \
font-family="monospace" font-size="12">
<style>rect{{fill:#fff;stroke:#5b6770}}path{{fill:none;stroke:#1f5f99;stroke-opacity:.5;\
marker-end:url(#tip)}}.title{{font-size:15px;font-weight:bold}}</style>
<defs><marker id="tip" markerWidth="7" markerHeight="7" refX="6" refY="3" orient="auto">\
<path d="M0,0 L6,3 L0,6" style="marker-end:none"/></marker></defs>
<rect width="100%" height="100%" style="stroke:none"/>
"""

if __name__ == "__main__":
    Path(sys.argv[1]).write_text(drawing(), encoding="utf-8")
