"""Where answers may send the arm: the edge of each limit, from both sides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cell.serving.bench import Taught
from tests.cell.serving.room import MARGIN_MM, Room
from tests.invariant.simulation.teaching import calibrations
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.places import followed_point, work_tip
from vgrd.cell.serving.limits import excess_of, excesses_of, summary, taught_pose
from vgrd.config.limits_section import LimitsSection
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import (
    Bounds,
    CellBounds,
    Motion,
    Policy,
    frozen_array,
)
from vgrd.registers.limits import LIMIT_STATUS, LimitCode

OPEN = CellBounds(Bounds(margin_mm=1e6, cone_rad=math.pi))
EPSILON_MM, EPSILON_RAD = 2e-3, 1e-6  # far above the rounding that is let pass


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


def edges(calibration: Calibration, pose: Pose) -> dict[LimitCode, tuple[str, float, Array]]:
    """For each limit: a field of the bounds, its value of a pose, and an outward direction in base."""
    tip = followed_point(calibration, pose)
    out: dict[LimitCode, tuple[str, float, Array]] = {}
    for first, point in ((LimitCode.FLANGE_X, pose.translation), (LimitCode.TIP_X, tip)):
        for axis in range(3):
            out[LimitCode(first + axis)] = ("highest", float(point[axis]), np.eye(3)[axis])
        radius = math.hypot(point[0], point[1])
        outwards = np.array([point[0], point[1], 0.0]) / radius
        out[LimitCode(first + 3)] = ("outer_radius_mm", radius, outwards)
    return out


@pytest.mark.parametrize("code", [code for code in LimitCode if code <= LimitCode.TIP_RADIUS])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_workspace_is_left_just_beyond_its_edge(room: Room, code: LimitCode, sign: int) -> None:
    tag = room.tag(room.object_at(1.0))
    pose = room.expected("P1", tag, Policy.FIXED).base_from_wrist
    field, value, outwards = edges(room.calibration, pose)[code]
    if field == "highest":
        corner = np.full(3, sign * np.inf)
        corner[code - (LimitCode.FLANGE_X if code < LimitCode.TIP_X else LimitCode.TIP_X)] = value
        limits = {"highest" if sign > 0 else "lowest": frozen_array(corner, 3)}
    else:
        limits = {field if sign > 0 else "inner_radius_mm": value}
    bounds = CellBounds(replace(Bounds(), **limits))
    step = sign * EPSILON_MM * outwards
    for way, beyond in ((-step, False), (0 * step, False), (step, True)):
        moved = Pose(pose.rotation, pose.translation + way)
        broken = excesses_of(room.calibration, "P1", moved, Policy.FIXED, bounds)
        found = [excess for excess in broken if excess.code is code]
        assert bool(found) is beyond
        for excess in found:
            assert abs(excess.value - excess.limit) == pytest.approx(EPSILON_MM, abs=1e-4)


@pytest.mark.parametrize(
    ("direction", "code"),
    [
        ("out", LimitCode.PLACE_RADIUS),
        ("up", LimitCode.PLACE_HEIGHT),
        ("round", LimitCode.PLACE_IN_TAG),
    ],
)
def test_a_target_leaves_the_calibrated_volume_beyond_the_margin(
    room: Room, direction: str, code: LimitCode
) -> None:
    """The margin of the axis has a doubt of some tenths added, so both sides keep a little off it."""
    angle = 0.7
    tag, table = room.tag(room.object_at(angle)), room.plant.layout.base_from_table
    pose = room.expected("P1", tag, Policy.FIXED).base_from_wrist
    x, y, _ = room.plant.layout.targets["P1"].cad
    outwards = exp_rotation((0, 0, angle)) @ np.array([x, y, 0.0]) / math.hypot(x, y)
    up = np.array([0.0, 0.0, 1.0])
    way = {"out": outwards, "up": up, "round": np.cross(up, outwards)}[direction]
    for sign in (1, -1):
        for share, beyond in ((0.95, False), (1.15, True)):
            shift = table.rotation @ way * sign * share * MARGIN_MM
            seen = None if direction != "round" else tag
            moved = Pose(pose.rotation, pose.translation + shift)
            excess = (
                excess_of(room.calibration, "P1", moved, Policy.FIXED, CellBounds())
                if seen is None
                else room.excess(moved, tag, Policy.FIXED)
            )
            assert (excess is not None) is beyond
            assert excess is None or excess.code is code


@pytest.mark.parametrize(
    ("cone_deg", "lean_deg", "code"),
    [
        (60.0, 59.5, None),
        (60.0, 60.5, LimitCode.CONE),
        (60.0, 89.0, LimitCode.CONE),
        (60.0, 91.0, LimitCode.SIDE),
        (60.0, 180.0, LimitCode.SIDE),
        (120.0, 119.5, None),
        (120.0, 120.5, LimitCode.SIDE),
        (180.0, 180.0, None),
        (10.0, 9.5, None),
        (10.0, 10.5, LimitCode.CONE),
    ],
)
def test_the_tool_leans_within_its_cone(
    room: Room, cone_deg: float, lean_deg: float, code: LimitCode | None
) -> None:
    bounds = CellBounds(Bounds(cone_rad=math.radians(cone_deg)))
    tag = room.tag(room.object_at(3.0))
    for yaw in (0.0, 2.0, 4.0):
        lean = exp_rotation(math.radians(lean_deg) * np.array([np.cos(yaw), np.sin(yaw), 0.0]))
        work = lean @ room.calibration.taught["P1"].base_from_work
        pose = room.expected("P1", tag, Policy.REQUESTED, work).base_from_wrist
        excess = room.excess(pose, tag, Policy.REQUESTED, bounds=bounds)
        assert (None if excess is None else excess.code) is code


def test_a_step_is_as_far_as_the_flange_is_from_where_it_was_taught(room: Room) -> None:
    taught = taught_pose(room.calibration.taught["P1"])
    turn = exp_rotation((0, 0, 0.3))
    for key, code, step, limit, epsilon in (
        ("step_mm", LimitCode.STEP, Pose(np.eye(3), np.array([3.0, 0.0, 4.0])), 5.0, EPSILON_MM),
        ("step_rad", LimitCode.TURN, Pose(turn, np.zeros(3)), 0.3, EPSILON_RAD),
    ):
        sent = Pose(step.rotation @ taught.rotation, taught.translation + step.translation)
        for bound, beyond in ((limit + epsilon, False), (limit, False), (limit - epsilon, True)):
            bounds = CellBounds(replace(OPEN.cell, **{key: bound}))
            excess = excess_of(room.calibration, "P1", sent, Policy.FIXED, bounds)
            assert (excess is not None) is beyond
            assert excess is None or excess.code is code


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(-800, 800), min_size=3, max_size=3),
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.sampled_from(Policy),
    st.floats(1.0, 500.0),
    st.floats(0.01, 3.1),
    st.floats(1.0, 3.0),
)
def test_wider_limits_refuse_nothing_that_narrower_ones_allow(
    place: list[float], rotvec: list[float], policy: Policy, mm: float, rad: float, wider: float
) -> None:
    """A law: also that without limits nothing is refused, and that any pose whatever is judged."""
    calibration = calibrations(Motion.TURNTABLE)[0]
    pose = Pose.from_rotvec(rotvec, place)

    def refused(scale: float) -> bool:
        corner = frozen_array([scale * mm] * 3, 3)
        limits = Bounds(
            frozen_array(-corner, 3),
            corner,
            0.0,
            scale * mm,
            scale * mm,
            min(scale * rad, math.pi),
            scale * mm,
            scale * rad,
        )
        return excess_of(calibration, "P3", pose, policy, CellBounds(limits)) is not None

    assert refused(1.0) or not refused(wider)
    assert excess_of(calibration, "P3", pose, policy, OPEN) is None


def test_a_target_with_limits_of_its_own_has_those_and_no_other_has_them(room: Room) -> None:
    own = CellBounds(Bounds(), {"P1": replace(Bounds(), highest=frozen_array((0, 0, 0), 3))})
    tag = room.tag(room.object_at(0.0))
    for target, code in (("P1", LimitCode.FLANGE_X), ("P2", None)):
        pose = room.expected(target, tag, Policy.FIXED).base_from_wrist
        excess = room.excess(pose, tag, Policy.FIXED, target, own)
        assert (None if excess is None else excess.code) is code


@pytest.mark.parametrize("tip", ["known", "open", "badly known"])
def test_without_a_tip_the_flange_is_held_against_what_stays_the_same_of_it(
    taught: Taught, tip: str
) -> None:
    solution = taught.calibration.solution
    part = solution.layout.TCP
    left_open, covariance = np.zeros((len(solution.covariance), 1)), solution.covariance.copy()
    if tip == "open":
        left_open[part] = 500.0
    elif tip == "badly known":  # as an arm of four axes leaves it
        covariance[part, part] += np.diag([0.0, 0.0, 50.0**2])
    changed = replace(solution, undetermined=left_open, covariance=covariance)
    calibration = replace(taught.calibration, solution=changed)
    assert (work_tip(calibration) is not None) is (tip == "known")
    axis = (solution.base_from_camera @ solution.camera_from_axis).rotation[:, 2]
    pose = taught_pose(calibration.taught["P1"])
    for policy in (Policy.FIXED, Policy.FOLLOW):
        assert excess_of(calibration, "P1", pose, policy, CellBounds()) is None
        raised = Pose(pose.rotation, pose.translation + 1.3 * MARGIN_MM * axis)
        excess = excess_of(calibration, "P1", raised, policy, CellBounds())
        assert excess is not None
        assert excess.code is LimitCode.PLACE_HEIGHT
    turned = Pose(exp_rotation((0.3, 0, 0)) @ pose.rotation, pose.translation + 99 * axis)
    excess = excess_of(calibration, "P1", turned, Policy.REQUESTED, CellBounds())
    assert (excess is not None) is (tip == "known")  # where a tip is, a flange alone does not tell


def test_words_tell_what_by_how_much_and_the_remedy(room: Room) -> None:
    tag = room.tag(room.object_at(0.0))
    pose = room.expected("P1", tag, Policy.FIXED).base_from_wrist
    bounds = CellBounds(replace(Bounds(), highest=frozen_array((9e9, 9e9, 100), 3)))
    excess = room.excess(pose, tag, Policy.FIXED, bounds=bounds)
    assert excess is not None
    words = excess.words("P1")
    for part in (
        "P1",
        "flange, in Z",
        f"{pose.translation[2] - 100:.3f} mm beyond",
        "highest_mm",
        "vgrd reload",
    ):
        assert part in words
    told = summary(room.calibration, bounds)
    assert "to 100 mm in Z" in str(told["cell"])
    assert set(told["beyond"]) == set(room.calibration.taught)  # type: ignore[call-overload]
    assert "beyond" not in summary(room.calibration, CellBounds())


def test_every_limit_has_a_status_and_keys_that_the_cell_file_has() -> None:
    assert set(LIMIT_STATUS) == set(LimitCode)
    for code in LimitCode:
        assert set(code.key.split(", ")) <= set(LimitsSection.model_fields)
    keys = {key for code in LimitCode for key in code.key.split(", ")}
    assert keys == set(LimitsSection.model_fields)
