"""On a CB3, which reads register by register, a coordinate is never put together of two answers."""

import numpy as np

from tests.robot_programs.trying import RUNS, TEXTS
from tests.robot_programs.world import COORDINATE, When, World

SCRIPT = TEXTS["urscript for CB3"]
CARELESS = SCRIPT.replace("not vgrd_is_whole or ", "")
OTHER = tuple(number + 2_000 for number in COORDINATE)  # um and urad; nothing else objects to it
ASKS = """
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


def seen(directory, script: str) -> list[tuple[int, ...]]:
    """Coordinates that are accepted while answers follow each other at any moment, um and urad."""
    world = World(directory, When.START, lambda _: None)
    run = RUNS["urscript for CB3"](world, script + ASKS)
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


def test_no_coordinate_is_of_two_answers(tmp_path):
    accepted = seen(tmp_path, SCRIPT)
    assert set(accepted) == {COORDINATE, OTHER}
    assert len(accepted) > 10


def test_without_the_check_some_are(tmp_path):
    assert CARELESS != SCRIPT
    assert set(seen(tmp_path, CARELESS)) - {COORDINATE, OTHER}
