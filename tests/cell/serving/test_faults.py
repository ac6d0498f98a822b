"""What a fault of the robot, the camera, the calibration or of ours says in the registers, and what ends it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.cell.serving.bench import Bench, StillMeasuring, Taught, turned
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.faults import tcp_difference
from vgrd.errors import ControlError, InputError, NotObservable, StoreError
from vgrd.geometry import Pose
from vgrd.registers import State, Status


@pytest.mark.parametrize("moment", ["picture", "second"])
def test_a_calibration_activated_during_a_request_ends_it(
    bench: Bench, taught: Taught, moment: str
) -> None:
    """Neither the old one's coordinate nor its identity may come out afterwards."""
    other = replace(taught.calibration, id="cal-000009")
    turning = moment == "second"
    bench.measuring.coming = [turned(taught, 0.3, 1000.21), turned(taught, 0.3, 1000.25)]
    fresh = bench.measuring.fresh

    async def switching(timeout_s: float, *, whole: bool = True) -> Sight:
        sight = await fresh(timeout_s, whole=whole)
        if whole is not turning:
            bench.serving.use(other, 77)
        return sight

    bench.measuring.fresh = switching  # type: ignore[method-assign]
    assert bench.ask().answer.status is Status.CALIBRATION_MISMATCH


class Unforeseen(Exception):
    """A fault of ours."""


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (NotObservable("no", rank=1, unknowns=2), Status.CALIBRATION_MISMATCH),
        (InputError("no pivot"), Status.BAD_PARAMETER),
        (np.linalg.LinAlgError("singular"), Status.INTERNAL_ERROR),
        (StoreError("disk"), Status.INTERNAL_ERROR),
    ],
)
def test_every_error_of_a_request_ends_it_with_a_status(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, error: Exception, status: Status
) -> None:
    monkeypatch.setattr("vgrd.cell.serving.service.answer_request", raising(error))
    image = bench.ask()
    assert (image.answer.status, image.answer.echo) == (status, 7)
    monkeypatch.undo()
    assert bench.ask(TRIG=8).answer.status is Status.OK


def test_a_fault_of_ours_ends_the_request_with_900_and_then_the_process(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vgrd.cell.serving.service.answer_request", raising(Unforeseen()))
    with pytest.raises(ExceptionGroup):
        bench.ask()
    image = bench.read()
    assert (image.answer.status, image.answer.echo) == (Status.INTERNAL_ERROR, 7)


def raising(error: Exception) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("spoil", "status"),
    [
        (lambda m: m.troubles.update(robot="gone"), Status.ROBOT_OFFLINE),
        (lambda m: setattr(m, "running", False), Status.ROBOT_SAFETY_STOP),
        (lambda m: setattr(m, "tcp", Pose.identity()), Status.TCP_OFFSET_CHANGED),
    ],
)
def test_a_fault_of_the_robot_withdraws_the_answer(
    bench: Bench, spoil: Callable[[StillMeasuring], None], status: Status
) -> None:
    assert bench.ask().answer.status is Status.OK
    spoil(bench.measuring)
    image = bench.read()
    assert image.answer.status is status
    assert not image.state & State.READY
    assert bench.ask().answer.status is status


def test_a_changed_tcp_stays_a_fault_until_it_is_confirmed(bench: Bench) -> None:
    bench.ask()
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    with pytest.raises(ControlError, match="still there"):
        bench.serving.confirm()
    bench.measuring.tcp = right
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.serving.confirm()
    assert bench.ask().answer.status is Status.OK


def test_a_latched_fault_is_not_confirmed_while_the_robot_tells_nothing(bench: Bench) -> None:
    bench.ask()
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.measuring.troubles["robot"] = "gone"
    with pytest.raises(ControlError, match="nobody can tell"):
        bench.serving.confirm()
    bench.measuring.troubles["robot"], bench.measuring.tcp = "", right
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.serving.confirm()
    assert bench.ask().answer.status is Status.OK


def test_a_latch_and_its_end_are_handed_on_to_be_kept(bench: Bench) -> None:
    kept: list[object] = []
    bench.serving.faults.on_latch.append(kept.append)
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    bench.read()
    bench.read()
    bench.measuring.tcp = right
    assert [status for status, _ in kept] == [Status.TCP_OFFSET_CHANGED]  # type: ignore[misc]
    bench.serving.confirm()
    assert kept[1:] == [None]


def test_a_camera_without_pictures_is_told(bench: Bench) -> None:
    bench.measuring.sight = None
    assert bench.ask().answer.status is Status.GRAB_TIMEOUT
    bench.measuring.troubles["camera"] = "unplugged"
    assert bench.ask().answer.status is Status.CAMERA_OFFLINE


def test_a_camera_known_to_be_lost_is_told_without_waiting_for_a_picture(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def never(timeout_s: float) -> Sight:
        raise AssertionError(f"waited {timeout_s} s")

    monkeypatch.setattr(bench.measuring, "fresh", never)
    bench.measuring.troubles["camera"] = "unplugged"
    assert bench.ask().answer.status is Status.CAMERA_OFFLINE


def test_a_cell_that_drifted_stops_serving(bench: Bench, taught: Taught) -> None:
    assert taught.sight.base_from_wrist is not None
    bumped = Pose.from_rotvec((0, 0, 0), (3.0, 0, 0)) @ taught.sight.base_from_wrist
    for _ in range(3):
        bench.measuring.show(replace(taught.sight, base_from_wrist=bumped))
    assert bench.ask().answer.status is Status.CALIBRATION_DRIFT
    bench.measuring.show(taught.sight)
    assert bench.ask().answer.status is Status.OK


def test_without_a_calibration_nothing_is_served(bench: Bench) -> None:
    bench.serving.serve_none(Status.CALIBRATION_MISMATCH, "of another cell")
    assert bench.ask().answer.status is Status.CALIBRATION_MISMATCH
    assert bench.serving.fault() == (Status.CALIBRATION_MISMATCH, "of another cell")


def test_a_tcp_that_the_robot_does_not_tell_is_no_difference() -> None:
    assert tcp_difference(None, Pose.identity()) == ""
    assert tcp_difference(Pose.identity(), None) == ""
    assert "5.00 mm" in tcp_difference(Pose.identity(), Pose.from_rotvec((0, 0, 0), (0, 0, 5.0)))
