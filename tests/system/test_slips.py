"""A tag that slips a little on the running cell: refused, taken over by a person, borne out by a touch."""

import time
from collections.abc import Mapping

import pytest

from fakes.cell.daemon import Daemon
from fakes.world.poses import WORK_ROTATION, retracted_pose
from vgrd.errors import ControlError

pytestmark = pytest.mark.system

COMES_WITHIN_S = 120.0
SLIP_MM = (
    0.3  # of tag B in its plane: less than `stability_mm`, far more than the calibration errs
)


def wait_for_fault(daemon: Daemon, words: str) -> None:
    end = time.monotonic() + COMES_WITHIN_S
    while time.monotonic() < end:
        fault = daemon.call("status")["fault"]
        if fault is not None and words in fault["reason"]:
            return
        time.sleep(0.1)
    raise AssertionError(f"{words!r} was not told, but {fault}")


def patiently(daemon: Daemon, operation: str, **arguments: str) -> Mapping[str, object]:
    """What the daemon replies once it no longer asks for more pictures."""
    end = time.monotonic() + COMES_WITHIN_S
    while True:
        try:
            return daemon.call(operation, **arguments)
        except ControlError as refused:
            if "wait" not in str(refused) or time.monotonic() > end:
                raise
            time.sleep(0.5)


def test_a_tag_b_that_slipped_is_taken_over_borne_out_and_taken_back(live) -> None:
    daemon, world = live.daemon, live.cell.world
    operator = live.cell.operator(daemon)
    operator.jog(retracted_pose())
    daemon.wait_until(lambda status: bool(status["serving"]))
    before = daemon.call("ec", target="P1")
    world.shift_tag_b(SLIP_MM, 0.0)
    wait_for_fault(daemon, "tag B sits elsewhere")
    adopted = patiently(daemon, "confirm", accept="tag B")
    assert adopted["link"] == "tag B"
    assert 0.1 < float(str(adopted["slip_mm"])) < 2 * SLIP_MM
    assert adopted["calibration"] != live.cell.calibration
    daemon.wait_until(lambda status: bool(status["serving"]))
    after = daemon.call("ec", target="P1")
    assert after["u95_mm"] > before["u95_mm"]
    miss = max(
        abs(a - b) for a, b in zip(after["position_mm"], before["position_mm"], strict=True)
    )
    assert miss < after["u95_mm"]

    daemon.call("record.start", session="bears-it-out")
    world.jog_onto("P1", WORK_ROTATION, time.monotonic())
    time.sleep(5.0)
    reply = patiently(daemon, "verify", target="P1")
    daemon.call("record.stop")
    assert reply["adopted_slip"] == "borne out"
    operator.jog(retracted_pose())

    world.shift_tag_b(0.0, 0.0)
    daemon.call("activate", calibration=live.cell.calibration)
    daemon.wait_until(lambda status: bool(status["serving"]))
    status = daemon.call("status")
    assert (status["calibration"], status["fault"]) == (live.cell.calibration, None)


def test_nothing_is_taken_over_where_nothing_slipped(live) -> None:
    live.daemon.wait_until(lambda status: bool(status["serving"]))
    with pytest.raises(ControlError, match="show no slip"):
        live.daemon.call("confirm", accept="tag B")
    with pytest.raises(ControlError, match="choose one of camera, tag A, tag B, object"):
        live.daemon.call("confirm", accept="tagB")
