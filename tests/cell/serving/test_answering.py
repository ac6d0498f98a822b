"""What one request is answered with: the right coordinate in each format, or the code of its refusal."""

from dataclasses import replace

import numpy as np
import pytest

from tests.cell.serving.bench import CALIBRATION_ID, LIMITS, NONCE, Taught, request
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.joint.state import StepLayout
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import answer_request, check_request
from vgrd.errors import NotSteady
from vgrd.geometry import Pose
from vgrd.model import Verdict
from vgrd.registers import PolicyCode, Request, RotationCode, Status


def answered(taught: Taught, asked: Request, sight: Sight | None = None, now_s: float = 1000.5):
    answer, _ = answer_request(
        asked, taught.calibration, CALIBRATION_ID, sight or taught.sight, LIMITS, now_s, 1.7e9
    )
    return answer


def test_a_good_request_leads_the_true_tip_to_the_target(taught: Taught) -> None:
    for number in range(1, 7):
        asked = request(POINT=number)
        assert check_request(asked, taught.calibration) is None
        answer = answered(taught, asked)
        assert (answer.status, answer.echo, answer.point) == (Status.OK, 7, number)
        pose = Pose.from_rotvec(answer.rotation, np.array(answer.position_um) / 1000)
        assert np.linalg.norm(taught.world.miss_at(pose, f"P{number}", 0.7)) < 0.05
        assert answer.calibration_id == CALIBRATION_ID
        assert answer.valid_until_s == 1003.0
        assert answer.tags == 2


@pytest.mark.parametrize("code", list(RotationCode))
def test_all_rotation_formats_mean_the_same_orientation(
    taught: Taught, code: RotationCode
) -> None:
    from scipy.spatial.transform import Rotation

    answer = answered(taught, request(OPT=code << 4))
    euler = {RotationCode.RPY: "xyz", RotationCode.KUKA_ABC: "ZYX", RotationCode.ZYZ: "ZYZ"}
    turned = (
        Rotation.from_rotvec(answer.rotation)
        if code is RotationCode.ROTVEC
        else Rotation.from_euler(euler[code], answer.rotation, degrees=True)
    )
    reference = Rotation.from_rotvec(answered(taught, request()).rotation)
    assert (turned.inv() * reference).magnitude() < 1e-9


@pytest.mark.parametrize("code", list(RotationCode))
def test_the_tip_meets_the_target_with_the_wrist_as_the_robot_requests(
    taught: Taught, code: RotationCode
) -> None:
    from scipy.spatial.transform import Rotation

    work = Rotation.from_euler("xyz", (170.0, 12.0, 35.0), degrees=True)
    euler = {RotationCode.RPY: "xyz", RotationCode.KUKA_ABC: "ZYX", RotationCode.ZYZ: "ZYZ"}
    if code is RotationCode.ROTVEC:
        values = work.as_rotvec() * 1e6
    else:
        values = work.as_euler(euler[code], degrees=True) * 1e4
    x, y, z = (round(value) for value in values)
    options = PolicyCode.REQUESTED << 8 | code << 4
    answer = answered(taught, request(OPT=options, ORI_RX=x, ORI_RY=y, ORI_RZ=z))
    assert answer.status is Status.OK
    pose = Pose(work.as_matrix(), np.array(answer.position_um) / 1000)
    assert np.linalg.norm(taught.world.miss_at(pose, "P1", 0.7)) < 0.08


def test_the_wrist_turns_with_the_object_when_it_is_to_follow(taught: Taught) -> None:
    fixed = answered(taught, request(OPT=PolicyCode.FIXED << 8))
    follow = answered(taught, request(OPT=PolicyCode.FOLLOW << 8))
    turn = Pose.from_rotvec(fixed.rotation).inverse() @ Pose.from_rotvec(follow.rotation)
    assert np.linalg.norm(turn.rotvec()) == pytest.approx(0.7, abs=2e-3)
    pose = Pose.from_rotvec(follow.rotation, np.array(follow.position_um) / 1000)
    assert np.linalg.norm(taught.world.miss_at(pose, "P1", 0.7)) < 0.08


def test_the_tcp_pose_is_given_where_the_tcp_is_known(taught: Taught) -> None:
    flange, tcp = answered(taught, request()), answered(taught, request(OPT=2))
    way = (np.array(tcp.position_um) - np.array(flange.position_um)) / 1000
    assert np.linalg.norm(way) == pytest.approx(
        np.linalg.norm(taught.world.layout.tcp_in_wrist), abs=0.05
    )


@pytest.mark.parametrize(
    ("fields", "status", "detail"),
    [
        ({"CMD": 3}, Status.UNKNOWN_COMMAND, 3),
        ({"CMD": 99}, Status.UNKNOWN_COMMAND, 99),
        ({"POINT": 77}, Status.UNKNOWN_POINT, 77),
        ({"OPT": 9 << 4}, Status.BAD_PARAMETER, 3),
        *(({"OPT": 1 << bit}, Status.BAD_PARAMETER, 3) for bit in (2, 3, *range(10, 16))),
        ({"OPT": 3 << 8, "oriented": False}, Status.BAD_PARAMETER, 23),
        ({"CMD": 5}, Status.UNKNOWN_COMMAND, 5),
        ({"CMD": 6}, Status.UNKNOWN_COMMAND, 6),
        ({"ROBOT": 2}, Status.BAD_PARAMETER, 4),
        ({"TOOL": 5}, Status.BAD_PARAMETER, 6),
    ],
)
def test_what_cannot_be_served_is_refused_with_its_code(
    taught: Taught, fields: dict[str, int], status: Status, detail: int
) -> None:
    refusal = check_request(request(**fields), taught.calibration)
    assert refusal is not None
    assert (refusal.status, refusal.detail, refusal.echo) == (status, detail, 7)


@pytest.mark.parametrize("register", [10, 21, 29, 31])
def test_a_value_in_a_reserved_register_is_refused_with_the_register(
    taught: Taught, register: int
) -> None:
    registers = bytearray(request().registers)
    registers[2 * register] = 1
    refusal = check_request(Request.parse(bytes(registers), NONCE), taught.calibration)
    assert refusal is not None
    assert (refusal.status, refusal.detail) == (Status.BAD_PARAMETER, register)


def test_a_client_that_counts_in_clhb_is_not_refused(taught: Taught) -> None:
    assert check_request(request(CLHB=0xFFFF), taught.calibration) is None


def test_a_tcp_that_is_not_known_is_not_served(taught: Taught) -> None:
    solution = taught.calibration.solution
    left_open = np.zeros((len(solution.covariance), 1))
    left_open[StepLayout.TCP] = 500.0
    unknown = replace(taught.calibration, solution=replace(solution, undetermined=left_open))
    assert unknown.tcp is None
    for options in (2, 3 << 8):
        refusal = check_request(request(OPT=options), unknown)
        assert refusal is not None
        assert (refusal.status, refusal.detail) == (Status.BAD_PARAMETER, 3)


def test_each_doubt_has_its_status(taught: Taught) -> None:
    blind = replace(taught.sight, tag_b=None)
    moving = replace(taught.sight, base_from_wrist=None, unpaired=NotSteady("moving"))
    assert answered(taught, request(), blind).status is Status.TAG_B_NOT_FOUND
    assert answered(taught, request(OPT=1), moving).status is Status.ROBOT_MOVING
    assert answered(taught, request(), moving).status is Status.OK
    assert answered(taught, request(), now_s=1003.0).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXAGE=100)).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXU95=1)).status is Status.UNCERTAINTY_TOO_HIGH


def test_the_calibration_of_the_tests_is_accepted(taught: Taught) -> None:
    calibration: Calibration = taught.calibration
    assert calibration.verdict.ok, calibration.verdict
    assert isinstance(calibration.verdict, Verdict)
