"""What the machine found, each by name, as it happened; the tests of the rooms pin the parts.

tests/cell/serving/test_pictures.py: a picture from before a move, served as the newest one.
"""

from collections.abc import Generator

from tests.invariant.reading.robots import Asked, pieces
from tests.invariant.rig import Rig, silence
from tests.invariant.simulation.teaching import Variant
from vgrd.registers import Command


def read_some(
    rig: Rig, steps: Generator[int, None, bytes | None], count: int
) -> list[bytes | None]:
    """Read so many registers, or to the end: what was assembled then."""
    ends: list[bytes | None] = []

    def read() -> None:
        try:
            next(steps)
        except StopIteration as end:
            ends.append(end.value)

    while count and not ends:
        rig._in_loop(read)
        count -= 1
    return ends


def test_a_slow_reader_takes_no_half_of_an_answer_of_an_earlier_life_of_the_cell(tmp_path):
    """Every life counted its answers from 1: SEQ was the same before and after, and even."""
    with silence(), Rig(tmp_path, Variant(), seed=1) as rig:
        rig.ask(0, Asked(0, Command.EC_FRESH, 1))
        rig.wait(1.0)
        steps = pieces(rig.robots.links[1])
        assert read_some(rig, steps, 30) == []
        rig.kill("cell")
        rig.wait(4.0)
        rig.ask(0, Asked(0, Command.EC_FRESH, 4))
        rig.wait(1.0)
        assert rig.robots.desk.state & 4
        assert read_some(rig, steps, 100) == [None]


def test_a_table_that_turned_before_the_newest_picture_was_asked_for_is_not_served_where_it_was(
    tmp_path,
):
    """For longer than P + L + 0.1 s: the earlier pictures agreed with each other, and nobody looked again."""
    with silence(), Rig(tmp_path, Variant(), seed=1) as rig:
        for pause_s in (0.1, 0.2, 0.3, 0.35, 0.4, 0.45):
            rig.write(0, 0, [0])
            rig.wait(2.3)
            now = rig.clock.now_s
            rig.plant.jerk(rig.plant.placements[-1].angle(now) + 0.3, now)
            rig.wait(pause_s)
            rig.ask(0, Asked(0, Command.EC_NEWEST, 2))
            rig.wait(1.0)
        assert rig.judge.counts["right"] > 100


def test_a_command_dies_with_the_cell_that_was_asked(tmp_path):
    with silence(), Rig(tmp_path, Variant(), seed=1) as rig:
        rig.wait(1.0)
        for name in ("gate", "cell", "gate", "cell"):
            rig.kill(name)
            rig.activate(rig.daemon.names[1])
            rig.wait(5.0)
        assert rig.judge.counts["reads"] > 100
