"""Limits from the cell file to the registers, through the real gate and the real cell in simulated time."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.invariant.reading.robots import Asked
from tests.invariant.rig import Rig, silence
from tests.invariant.simulation.teaching import Variant
from vgrd.errors import ControlError
from vgrd.registers import RESPONSE, Command, Status
from vgrd.registers.limits import LimitCode

ASKED = Asked(0, Command.EC_FRESH, 1)
UPSIDE_DOWN = Asked(0, Command.EC_FRESH, 1, 0x300)  # orientation 0 0 0, written
LYING = replace(UPSIDE_DOWN, orientation=(1_800_000, 0, 0))
BACK_S = 6.0  # until a cell that was started anew sees pictures
NEAR_MM = 400.0  # nearer to the base than the table is


@pytest.fixture
def rig(tmp_path) -> Iterator[Rig]:
    with silence(), Rig(tmp_path, Variant(), seed=2) as rig:
        yield rig


def told(rig: Rig, asked: Asked) -> tuple[Status, int]:
    """STATUS and DETAIL; the judge of the rig sees to it that sentinels stand beside a refusal."""
    rig.ask(0, asked)
    rig.wait(1.0)
    block = rig.robots.links[0].read(RESPONSE.start, RESPONSE.end - RESPONSE.start)
    assert block is not None
    values = RESPONSE.decode(block)
    return Status(int(values["STATUS"])), int(values["DETAIL"])


def test_a_tool_upside_down_is_never_offered(rig: Rig) -> None:
    assert told(rig, UPSIDE_DOWN) == (Status.POINT_NOT_VISIBLE, LimitCode.SIDE)
    assert told(rig, LYING) == (Status.UNREACHABLE, LimitCode.CONE)
    assert rig.judge.counts["valid"] == 0
    assert told(rig, ASKED)[0].is_ok


def test_reloaded_limits_count_and_the_calibration_serves_on(rig: Rig) -> None:
    assert told(rig, ASKED)[0].is_ok
    rig.reload(3.0, "mrad", NEAR_MM)
    rig.wait(BACK_S)
    assert told(rig, ASKED) == (Status.OUT_OF_WORKSPACE, LimitCode.FLANGE_RADIUS)
    rig.reload(3.0, "mrad")
    rig.wait(BACK_S)
    assert told(rig, ASKED)[0].is_ok
    assert rig.judge.counts["right"] > 100


def test_the_judge_sees_a_daemon_that_has_forgotten_its_limits(rig: Rig, monkeypatch) -> None:
    """Or else the machine of the invariant would find nothing."""
    monkeypatch.setattr("vgrd.cell.serving.answering.excess_of", lambda *_: None)
    with pytest.raises(AssertionError, match="beyond a limit, the tool leans by 76"):
        told(rig, LYING)


def test_a_person_is_told_what_is_beyond_which_limit_and_what_a_pose_is(rig: Rig) -> None:
    def call(name: str, **arguments: str) -> dict[str, object] | str:
        told: list[dict[str, object] | str] = []

        async def perform() -> None:
            operation = rig.daemon.cell.operations.table()[name]
            try:
                told.append(dict(await operation.perform(arguments)))
            except ControlError as err:
                told.append(str(err))

        rig.daemon.command(perform())
        rig.wait(2.0)
        return told[0]

    right = call("ec", target="P1")
    assert "base_from_wrist: the flange" in str(right["pose"])
    tip = np.array(right["tip_in_base_mm"])
    assert np.linalg.norm(tip - rig.plant.point("P1", rig.clock.now_s)) < 1.0
    refused = call("ec", target="P1", policy="requested", work_rotvec_deg="0 0 0")
    for part in (
        "P1: the tool's axis",
        "beyond the limit of 60.000 deg",
        "cone_deg",
        "603",
        "DETAIL 21",
    ):
        assert part in refused
    limits = call("status")["limits"]
    assert limits == {
        "cell": "target within 10 mm of where its object can take it; tool within 60 deg of the "
        "taught approach"
    }
