"""On a CB3, which reads register by register, a coordinate is never put together of two answers."""

from tests.robot_programs.trying import TEXTS
from tests.robot_programs.urscript.single_registers import OTHER, accepted
from tests.robot_programs.world import COORDINATE

SCRIPT = TEXTS["urscript for CB3"]
CARELESS = SCRIPT.replace("not vgrd_is_whole or ", "")


def test_no_coordinate_is_of_two_answers(tmp_path):
    found = accepted(tmp_path, SCRIPT)
    assert set(found) == {COORDINATE, OTHER}
    assert len(found) > 10


def test_without_the_check_some_are(tmp_path):
    assert CARELESS != SCRIPT
    assert set(accepted(tmp_path, CARELESS)) - {COORDINATE, OTHER}
