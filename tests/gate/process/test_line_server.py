"""The line server of a real gate: beside the registers, off unless it is asked for, invalid as soon as they are."""

import os
import signal

import pytest

from fakes.controllers.raw_lines import RawLines
from tests.gate.process.gate_process import (
    GateProcess,
    ask,
    cell,
    see,
    until,
)
from vgrd.registers import State, Status

pytestmark = pytest.mark.system

NOTHING = "99999.00"


@pytest.fixture
def gate(tmp_path):
    with GateProcess(tmp_path, [cell(tmp_path)], line_port=0) as running:
        with running.client() as client:
            until(lambda: see(client)["STATE"] == State.READY)
        yield running


@pytest.fixture
def robot(gate):
    with RawLines("127.0.0.1", gate.report().line_port) as made:
        yield made


def served(robot: RawLines, trig: int, point: int) -> list[str]:
    """A good answer to a line; asked again, with the next TRIG, where a busy machine lost the cell or the time."""
    trigs = iter(range(trig, trig + 50))
    while True:
        number = next(trigs)
        fields = until(
            lambda n=number: (f := robot.ask(point, n))[1] != str(Status.BUSY.value) and f
        )
        assert fields[0] == str(number)
        if fields[1] == str(Status.OK.value):
            return fields
        assert fields[4] == NOTHING


def test_a_line_is_answered_with_the_cells_coordinate_and_counted(gate, robot):
    fields = served(robot, 1, 5)
    assert fields[4:] == ["5.00", "0.00", "0.00", "0.000", "0.000", "90.000", "100"]
    counters = until(lambda: (c := gate.report().counters).get("line_requests") and c)
    assert counters["line_connections"] == counters["line_accepted"] == 1
    beats: set[str] = set()
    until(lambda: beats.add(robot.ask(5, int(fields[0]))[3]) or len(beats) > 3)


def test_a_killed_cell_takes_its_coordinate_from_the_line_and_it_never_comes_back(gate, robot):
    trig = int(served(robot, 1, 5)[0])
    os.kill(gate.pid("cell"), signal.SIGKILL)
    until(lambda: robot.ask(5, trig)[1] != str(Status.OK.value))
    with gate.client() as client:
        until(lambda: see(client)["STATE"] & State.READY)
        for _ in range(50):
            fields = robot.ask(5, trig)
            assert (fields[0], fields[4]) == (str(trig), NOTHING)
    assert served(robot, trig + 1, 6)[4] == "6.00"


def test_a_request_by_registers_takes_the_place_of_a_lines(gate, robot):
    trig = int(served(robot, 1, 5)[0])
    with gate.client() as client:
        ask(client, trig, 7)
        assert robot.ask(5, trig)[:2] == [str(trig), str(Status.SUPERSEDED.value)]
        again = served(robot, trig + 1, 5)
        assert see(client)["ECHO"] == 0
        assert see(client)["POINT"] == 5
        assert again[4] == "5.00"


def test_without_a_line_port_nothing_listens_for_lines(tmp_path):
    with GateProcess(tmp_path, [cell(tmp_path)]) as gate:
        report = gate.report()
        assert report.line_port is None
        assert not any(name.startswith("line_") for name in report.counters)
