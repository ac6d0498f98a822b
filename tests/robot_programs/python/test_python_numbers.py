"""The Python client and numbers that are none: every comparison with nan is false, so none of them may come in."""

import math
from dataclasses import fields

import pytest

from tests.robot_programs.python_run import FILE, PythonRun, module_of
from tests.robot_programs.world import Rest, When, World

CLIENT = module_of(FILE.read_text())
LIMITS = [field.name for field in fields(CLIENT.Limits)]


def program(**more):
    return CLIENT.Program(None, CLIENT.ModbusLink(CLIENT.Address(), 0.2), **more)


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_that_is_no_number_is_refused_by_its_name(name):
    box = isinstance(getattr(CLIENT.Limits(), name), tuple)
    limits = CLIENT.Limits(**{name: (0.0, math.nan, 0.0) if box else math.nan})
    with pytest.raises(ValueError, match=rf"Limits\.{name} is"):
        program(limits=limits)


def test_a_taught_pose_that_is_no_pose_is_refused():
    with pytest.raises(ValueError, match=r"Taught\.pose is"):
        program(taught=CLIENT.Taught(pose=(400.0, 0.0, math.nan, math.pi, 0.0, 0.0)))


def test_who_says_that_there_is_no_limit_has_none():
    assert program(limits=CLIENT.Limits(step_mm=math.inf)).state is CLIENT.State.DONE


def test_an_arm_that_does_not_tell_where_it_stands_is_not_there(tmp_path):
    run = PythonRun(World(tmp_path, When.START, lambda _: None), CLIENT)
    run.program.arm.flange_pose = lambda: (math.nan,) * 6
    outcome = run.start()
    assert (outcome.word, outcome.asks, outcome.rest) == ("APPROACH", 1, Rest.APPROACH)
