"""Limits through the serving path: refused in the registers, withdrawn when a standing answer drifts out."""

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cell.serving.bench import (
    CALIBRATION_ID,
    LIMITS,
    Bench,
    Taught,
    at,
    request,
    turned,
)
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import Limits, answer_request, told_flange
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.geometry.rotation_formats import RotationFormat, rotation_from, usual_rotvec
from vgrd.model import Bounds, CellBounds, frozen_array
from vgrd.registers import RESPONSE, PolicyCode, RegisterImage, Request, RotationCode, Status, view
from vgrd.registers.limits import LIMIT_STATUS, LimitCode

REQUESTED = PolicyCode.REQUESTED << 8
FOLLOW = PolicyCode.FOLLOW << 8
TCP = 2  # OPT b1
DEADLINE_S = 0.25
TARGETS = [f"P{number}" for number in range(1, 7)]
BESIDE_MM = 0.05  # of an edge: more than pictures without noise move, less than the drift


def registers(image: RegisterImage, asked: Request, now_s: float) -> dict[str, float]:
    """What a robot reads."""
    return RESPONSE.decode(view(image, now_s, deadline_s=DEADLINE_S, answered=asked).response)


def below(highest: Array, **others: float) -> Limits:
    """The limits of the bench, with a box for flange and tip."""
    bounds = CellBounds(replace(Bounds(), highest=frozen_array(highest, 3)))
    return replace(LIMITS, bounds=bounds, **others)


def test_an_orientation_of_nothing_puts_no_tool_upside_down(bench: Bench) -> None:
    """The tip would be on the target, the flange below the table."""
    image = bench.ask(OPT=REQUESTED)
    read = registers(image, request(OPT=REQUESTED), bench.clock.monotonic())
    assert (read["STATUS"], read["DETAIL"]) == (Status.POINT_NOT_VISIBLE, LimitCode.SIDE)
    assert math.isnan(read["ECF_Z"])
    assert read["EC32_Z"] == -(2**31)
    assert read["EC16_Z"] == -(2**15)
    assert int(read["SEQ"]) & 1
    assert bench.serving.standing.basis is None


def test_what_is_out_of_the_workspace_holds_sentinels_whatever_frame_is_asked(
    tmp_path: Path, taught: Taught
) -> None:
    z_mm = Bench(tmp_path, taught).ask().answer.position_um[2] / 1000
    for name, over_mm, status in (
        ("in", 0.01, Status.OK),
        ("out", -0.01, Status.OUT_OF_WORKSPACE),
    ):
        (tmp_path / name).mkdir()
        narrow = Bench(tmp_path / name, taught, below(np.array([1e6, 1e6, z_mm + over_mm])))
        for options in (0, TCP, RotationCode.KUKA_ABC << 4):
            image = narrow.ask(OPT=options)
            read = registers(image, request(OPT=options), narrow.clock.monotonic())
            assert read["STATUS"] == status
            assert math.isnan(read["ECF_Z"]) is not status.is_ok
            assert status.is_ok or read["DETAIL"] == LimitCode.FLANGE_Z


@pytest.mark.parametrize("options", [0, FOLLOW], ids=["fixed", "follow"])
def test_an_answer_whose_target_drifts_out_turns_invalid_and_does_not_come_back(
    tmp_path: Path, taught: Taught, options: int
) -> None:
    """It moves by less than `moved_mm`, so that nothing else would end it."""
    free = Bench(tmp_path, taught, replace(LIMITS, moved_mm=10.0))
    drift_rad = 0.02
    here = np.array(free.ask(OPT=options).answer.position_um) / 1000
    free.measuring.coming = [turned(taught, drift_rad, 1000.5), turned(taught, drift_rad, 1000.6)]
    there = np.array(free.ask(OPT=options).answer.position_um) / 1000
    axis = int(np.argmax(np.abs(there - here)[:2]))
    drift_mm = float(there[axis] - here[axis])
    assert abs(drift_mm) > 0.5
    corner = np.full(3, np.copysign(np.inf, drift_mm))
    corner[axis] = here[axis] + 0.5 * drift_mm
    key = "highest" if drift_mm > 0 else "lowest"
    bounds = CellBounds(replace(Bounds(), **{key: frozen_array(corner, 3)}))
    (tmp_path / "narrow").mkdir()
    narrow = Bench(tmp_path / "narrow", taught, replace(LIMITS, moved_mm=10.0, bounds=bounds))
    image = narrow.ask(OPT=options)
    assert image.answer.status is Status.OK
    narrow.measuring.show(at(taught.sight, 1000.3))
    assert narrow.read().answer.status is Status.OK
    narrow.measuring.show(turned(taught, drift_rad, 1000.4))
    ended = narrow.read().answer
    assert ended.status is Status.OUT_OF_WORKSPACE
    assert ended.detail in (LimitCode.FLANGE_X + axis, LimitCode.TIP_X + axis)
    assert not narrow.measuring.watching
    narrow.measuring.show(at(taught.sight, 1000.5))
    assert narrow.read().answer.status is Status.OUT_OF_WORKSPACE


def test_a_rotation_vector_stays_on_the_side_of_the_taught_wrists(taught: Taught) -> None:
    """Wrists that were taught by a hair more and less than half a turn: a box may hold RX, RY and RZ of all."""
    hair = {name: exp_rotation(((-1) ** i * 1e-4, 0, 0)) for i, name in enumerate(TARGETS)}
    points = {
        name: replace(point, base_from_work=frozen_array(hair[name] @ point.base_from_work, 3, 3))
        for name, point in taught.calibration.taught.items()
    }
    shortest = [Pose(point.base_from_work, np.zeros(3)).rotvec()[0] for point in points.values()]
    assert min(shortest) < -3
    assert max(shortest) > 3
    calibration = replace(taught.calibration, taught=points)
    vectors = []
    for angle in np.linspace(0, 2 * np.pi, 5):
        sight = turned(taught, float(angle), 1000.4)
        for number in range(1, 7):
            answer, _ = answer_request(
                request(POINT=number), calibration, CALIBRATION_ID, sight, LIMITS, 1000.5, 1.7e9
            )
            assert answer.status is Status.OK
            vectors.append(answer.rotation)
    side = usual_rotvec(points["P1"].base_from_work)
    assert np.abs(np.array(vectors) - side).max() < 0.01


FORMATS = {
    RotationCode.ROTVEC: RotationFormat.ROTVEC,
    RotationCode.RPY: RotationFormat.RPY_FIXED_XYZ_DEG,
    RotationCode.KUKA_ABC: RotationFormat.KUKA_ABC_DEG,
    RotationCode.ZYZ: RotationFormat.ZYZ_DEG,
}


@settings(max_examples=120, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_register_image_is_valid_beyond_the_limits(taught: Taught, data: st.DataObject) -> None:
    """Any request, any limits, any angle of the table; judged from the registers, by sums of its own."""
    code = data.draw(st.sampled_from(RotationCode))
    policy = data.draw(st.sampled_from(PolicyCode))
    options = policy << 8 | code << 4 | data.draw(st.sampled_from((0, TCP)))
    ori = {
        f"ORI_{axis}": data.draw(st.integers(-3_200_000, 3_200_000)) for axis in ("RX", "RY", "RZ")
    }
    asked = request(POINT=data.draw(st.integers(1, 6)), OPT=options, **ori)
    center = np.array([450.0, 0.0, 140.0])
    half = np.array([data.draw(st.floats(60.0, 400.0)) for _ in range(3)])
    limits = Bounds(
        lowest=frozen_array(center - half, 3),
        highest=frozen_array(center + half, 3),
        inner_radius_mm=data.draw(st.sampled_from((0.0, 380.0, 430.0))),
        outer_radius_mm=data.draw(st.sampled_from((math.inf, 480.0, 600.0))),
        margin_mm=data.draw(st.floats(0.5, 30.0)),
        cone_rad=data.draw(st.floats(0.001, math.pi)),
        step_mm=data.draw(st.sampled_from((math.inf, 60.0))),
        step_rad=data.draw(st.sampled_from((math.inf, 1.0))),
    )
    sight = _seen(taught, data.draw(st.integers(0, 11)))
    with TemporaryDirectory() as folder:
        bench = Bench(Path(folder), taught, replace(LIMITS, bounds=CellBounds(limits)))
        bench.measuring.sight = sight
        image = bench.ask(POINT=asked.point, OPT=options, **ori)
        read = registers(image, asked, bench.clock.monotonic())
        bench.reader.close()
    status = Status(int(read["STATUS"]))
    assert status.is_ok is not math.isnan(read["ECF_X"])
    if not status.is_ok:
        assert status in {*LIMIT_STATUS.values(), Status.UNCERTAINTY_TOO_HIGH}
        assert status is Status.UNCERTAINTY_TOO_HIGH or LIMIT_STATUS[int(read["DETAIL"])] is status  # type: ignore[index]
        return
    R = rotation_from([read[f"ECF_{axis}"] for axis in ("RX", "RY", "RZ")], FORMATS[code])
    tip_in_wrist = taught.calibration.tcp_in_wrist
    told = np.array([read[f"ECF_{axis}"] for axis in "XYZ"])
    flange = told - R @ tip_in_wrist if options & TCP else told
    for point in (flange, flange + R @ tip_in_wrist):
        assert (limits.lowest - BESIDE_MM <= point).all()
        assert (point <= limits.highest + BESIDE_MM).all()
        radius = math.hypot(point[0], point[1])
        assert limits.inner_radius_mm - BESIDE_MM <= radius
        assert radius <= limits.outer_radius_mm + BESIDE_MM
    table = taught.world.layout.base_from_table
    where = table.inverse() @ (flange + R @ tip_in_wrist)
    assert abs(where[2]) <= limits.margin_mm + 1.0
    assert abs(math.hypot(where[0], where[1]) - 60.0) <= limits.margin_mm + 1.0
    assert math.acos(np.clip(-R[2, 2], -1, 1)) <= limits.cone_rad + 0.01
    at_touch = taught.calibration.taught[f"P{asked.point}"]
    assert np.linalg.norm(flange - at_touch.flange_in_base) <= limits.step_mm + BESIDE_MM
    turn = Pose(at_touch.base_from_work, flange).distance(Pose(R, flange))[1]
    assert turn <= limits.step_rad + 1e-3


_SIGHTS: dict[int, Sight] = {}


def _seen(taught: Taught, twelfth: int) -> Sight:
    """The table turned by so many twelfths of a turn; rendered once."""
    if twelfth not in _SIGHTS:
        _SIGHTS[twelfth] = turned(taught, twelfth * np.pi / 6, 1000.0)
    return _SIGHTS[twelfth]


def test_what_is_judged_is_what_the_registers_tell(taught: Taught) -> None:
    for code in RotationCode:
        for options in (0, TCP, FOLLOW, FOLLOW | TCP):
            answer, expected = answer_request(
                request(OPT=options | code << 4),
                taught.calibration,
                CALIBRATION_ID,
                taught.sight,
                LIMITS,
                1000.5,
                1.7e9,
            )
            assert expected is not None
            mm, rad = told_flange(answer, taught.calibration).distance(expected.base_from_wrist)
            assert mm < 1e-3
            assert rad < 1e-9
