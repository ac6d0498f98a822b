"""Answers that follow each other at any moment, to a program that reads register by register, as on a CB3."""

from pathlib import Path

import numpy as np

from tests.robot_programs.urscript.urscript_run import UrscriptRun
from tests.robot_programs.world import COORDINATE, When, World

OTHER = tuple(number + 2_000 for number in COORDINATE)  # um and urad; nothing else objects to it
_ASKS = """
def asks():
  global accepted = []
  local n = 0
  while n < 60:
    if vgrd_ask() == "":
      global accepted = accepted + [vgrd_ec]
    end
    n = n + 1
  end
end
"""


def accepted(directory: Path, script: str) -> list[tuple[int, ...]]:
    """Coordinates that the program accepts, um and urad; those that were answered are COORDINATE and OTHER."""
    world = World(directory, When.START, lambda _: None)
    run = UrscriptRun(world, script + _ASKS)
    run.controller.start(run.names["vgrd_connect"])
    rng = np.random.default_rng(5)
    for _ in range(300):
        run.controller.frame()
    task = run.controller.start(run.names["asks"])
    world.grant(200.0)
    while task.lives:
        for _ in range(int(rng.integers(10, 150))):
            run.controller.frame()
        world.cell.coordinate = OTHER if world.cell.coordinate == COORDINATE else COORDINATE
        world.cell.answer_anew()
    run.close()
    return [tuple(round(number * 1e6) for number in pose) for pose in run.names["accepted"]]
