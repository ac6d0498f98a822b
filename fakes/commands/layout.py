"""The fake cell in words, and what its camera sees in the scripted poses."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from fakes.world import layout as written
from fakes.world import poses
from fakes.world.cells import CELL_HELP, DEFAULT, cell_called
from fakes.world.layout import Layout
from fakes.world.visibility import TAG_NAMES, Visibility, visible
from fakes.world.world import TagName
from vgrd.geometry import Pose

Shot = tuple[Pose, float]


def scripted(layout: Layout) -> dict[str, list[Shot]]:
    """List the poses and table angles of all that the operator and the robot program do."""
    targets = list(layout.targets)
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False).tolist()
    tilts = list(islice(poses.tilt_candidates(layout, 0, 15, 25), 20))
    touch = poses.touch_pose
    return {
        "hand-eye looks": [(pose, 0.0) for pose in poses.look_poses(layout, 12)],
        "touches, wrist constant": [(touch(layout, name), 0.0) for name in targets],
        "touches, wrist tilted": [
            (touch(layout, name, 0.0, tilt), 0.0)
            for name, tilt in zip(targets, poses.touch_tilts(layout, targets), strict=True)
        ],
        "touches, any tilt": [
            (touch(layout, name, 0.0, tilt), 0.0) for name in targets for tilt in tilts
        ],
        "touches, table turned": [
            (touch(layout, name, angle), angle) for name in targets for angle in angles
        ],
        "requests and spins": [(poses.retracted_pose(layout), angle) for angle in angles],
        "spike": [(pose, 0.0) for pose in poses.fixed_point_poses(layout, 10)],
    }


def main(cell: Annotated[str, typer.Option(help=CELL_HELP)] = DEFAULT) -> None:
    """Print the layout and how often each tag is in view, how tilted and how sharp."""
    kind = cell_called(cell)
    layout = kind.layout()
    print(written.__doc__)
    print(f"{kind.name}: {kind.purpose}")
    table = Table(
        title="what the camera sees",
        caption="tilt: deg to the line of sight; blur: px; any tilt: all ways, 15-25 deg",
    )
    table.add_column("poses", no_wrap=True)
    for heading in ("A", "B", "both", "tilt A", "tilt B", "blur"):
        table.add_column(heading, no_wrap=True, justify="right")
    hidden: Counter[str] = Counter()
    for name, shots in scripted(layout).items():
        sights = [
            {tag: visible(layout, tag, poses.frozen_snapshot(*shot)) for tag in TAG_NAMES}
            for shot in shots
        ]
        table.add_row(name, *_statistics(sights))
        hidden.update(
            f"tag {tag} {reason}"
            for sight in sights
            for tag in sight
            for reason in sight[tag].reasons
        )
    Console(width=100).print(table)
    print("hidden:", ", ".join(f"{reason} ({n})" for reason, n in hidden.most_common()))


def _statistics(sights: Sequence[Mapping[TagName, Visibility]]) -> list[str]:
    total = len(sights)
    counts = {tag: sum(sight[tag].seen for sight in sights) for tag in TAG_NAMES}
    both = sum(all(sight[tag].seen for tag in TAG_NAMES) for sight in sights)
    tilts = {tag: [np.degrees(sight[tag].tilt_rad) for sight in sights] for tag in TAG_NAMES}
    blur = max(sight[tag].defocus_px for sight in sights for tag in TAG_NAMES)
    return [
        *(f"{count}/{total}" for count in (counts["a"], counts["b"], both)),
        *(f"{min(tilts[tag]):.0f}-{max(tilts[tag]):.0f}" for tag in TAG_NAMES),
        f"{blur:.1f}",
    ]
