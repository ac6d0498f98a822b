"""The cell file's defaults are those that every process rests on."""

from vgrd.cell.serving.answering import Limits
from vgrd.config.cell_file import ServingSection
from vgrd.gate.settings import GateSettings
from vgrd.ipc.time_limits import DEADLINE_S, REQUEST_TIMEOUT_S
from vgrd.model import Policy


def test_all_default_time_limits_are_the_same() -> None:
    serving, gate = ServingSection(), GateSettings("cell", "127.0.0.1", 0, (), ())
    assert serving.deadline_s == gate.deadline_s == DEADLINE_S
    assert serving.timeout_s == gate.timeout_s == REQUEST_TIMEOUT_S
    assert Limits(Policy.FIXED, 3.0, 1.0, 0.5, 0.3).timeout_s == REQUEST_TIMEOUT_S
