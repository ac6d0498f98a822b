"""Every page in both themes and three sizes: `python -m tests.page.screenshots FOLDER`, or `make screenshots`.

A fake cell is taught by what the page says, so the pictures show what a user sees on the way.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S
from fakes.cell.playground import Playground
from fakes.cell.session import ask_until_answered
from fakes.controllers.robot_program import RobotProgram
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.world import World
from tests.page.browser import browser, open_page, press, tab
from tests.page.person import Person

SIZES = {"desk": (1280, 800), "tablet": (800, 1280), "phone": (390, 844)}
THEMES = ("light", "dark")
TABS = ("Cell", "Teach", "Result", "Runtime", "Sessions")
IN_DOCS = {
    "teaching-teach-desk-light": "teach",
    "taught-result-desk-light": "result",
    "taught-cell-desk-light": "cell",
    "taught-runtime-desk-dark": "runtime",
    "report": "report",
}
_DOCS_PX = (900, 1100)  # largest width and height of a picture in the documents
_SETTLE_S = 1.0  # charts and pictures come after the words
_ASKED = 6  # requests of the robot, so that Runtime has something to show


def main() -> int:
    """Teach, and take the pictures; says which parts of a page are wider than it."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("folder", type=Path)
    given.add_argument("--docs", type=Path, help="copy those of the documents there")
    options = given.parse_args()
    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    with (
        tempfile.TemporaryDirectory() as place,
        _cell(Path(place)) as (cell, daemon, playground, url),
        browser() as opened,
    ):
        faults = _all(opened, cell, daemon, playground, url, folder)
    if options.docs is not None:
        for shot, name in IN_DOCS.items():
            _shrink(folder / f"{shot}.png", options.docs / f"{name}.png")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


@contextmanager
def _cell(place: Path) -> Iterator[tuple[FakeCell, Daemon, Playground, str]]:
    """A cell that nobody has taught."""
    world, port = World(Layout(), 1, speed_mm_s=SPEED_MM_S, turn_rad_s=TURN_RAD_S), free_port()
    with (
        FakeCell(world, place, free_port(), page=port) as cell,
        Daemon(cell.cell_file, place / "vgrd.log") as daemon,
        Playground(world, 0) as playground,
    ):
        yield cell, daemon, playground, f"http://127.0.0.1:{port}/"


def _all(
    opened: Any, cell: FakeCell, daemon: Daemon, playground: Playground, url: str, folder: Path
) -> list[str]:
    daemon.wait_until(lambda status: status["robot"] == status["camera"] == "ok")
    page = open_page(opened, url)
    tab(page, "Teach")
    person = Person(page, playground, daemon.control)
    touched = 0
    while True:
        what = person.obey()
        print(what, flush=True)
        touched += what == "Touch a target"
        if what == "Touch a target" and touched == 5:
            faults = _shoot(opened, url, folder, "teaching", ("Teach",))
        if what == "Activate":
            break
    cell.world.move_flange(retracted_pose(), time.monotonic())
    with RobotProgram(cell.world, "127.0.0.1", cell.port) as program:
        for _ in range(_ASKED):
            ask_until_answered(program, 1)
        faults += _shoot(
            opened, url, folder, "taught", TABS, lambda: ask_until_answered(program, 1)
        )
    report = opened.new_page(viewport={"width": 900, "height": 1200})
    report.goto(f"{url}report")
    report.screenshot(path=folder / "report.png", full_page=True)
    return faults


def _shoot(
    opened: Any,
    url: str,
    folder: Path,
    when: str,
    tabs: tuple[str, ...],
    before: Callable[[], object] = lambda: None,
) -> list[str]:
    """Pictures of some tabs; what sticks out of a page. before: done for each tab anew."""
    faults = []
    for size, (width, height) in SIZES.items():
        for theme in THEMES:
            page = open_page(opened, url, color_scheme=theme)
            page.set_viewport_size({"width": width, "height": height})
            for name in tabs:
                tab(page, name)
                if name == "Sessions":
                    press(page, "LIST")
                if name == "Result":
                    press(page, "COMPARE")
                before()
                time.sleep(_SETTLE_S)
                page.screenshot(
                    path=folder / f"{when}-{name.lower()}-{size}-{theme}.png", full_page=True
                )
                if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
                    faults.append(f"{when} {name} {size} {theme}: wider than the screen")
            page.close()
    return faults


def _shrink(source: Path, to: Path) -> None:
    """Small enough for a repository: the top of a page, in few greys."""
    picture = cv2.imread(str(source))
    scale = min(1.0, _DOCS_PX[0] / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    to.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(to), small[: _DOCS_PX[1]], [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    sys.exit(main())
