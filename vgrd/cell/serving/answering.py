"""From a request and what was seen to an answer: pure, so that every refusal can be tested."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.places import base_from_tag
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.limits import Excess, excess_of
from vgrd.cell.serving.vouching import Hold
from vgrd.errors import Contradiction, InputError, NotObservable, TagNotSeen
from vgrd.geometry import Array, Pose
from vgrd.geometry.rotation_formats import RotationFormat as Format
from vgrd.geometry.rotation_formats import rotation_from, rotation_to, rotvec_near
from vgrd.model import (
    UNMOVED,
    CameraPlace,
    CellBounds,
    ExpectedCoordinate,
    Link,
    Policy,
    Target,
)
from vgrd.registers import (
    REQUEST,
    Answer,
    Command,
    Frame,
    PolicyCode,
    Request,
    RotationCode,
    Status,
    reply,
)
from vgrd.registers.limits import LIMIT_STATUS

NO_HOLD = Hold()
DEFAULT_BOUNDS = CellBounds()
_FORMATS = {
    RotationCode.ROTVEC: Format.ROTVEC,
    RotationCode.RPY: Format.RPY_FIXED_XYZ_DEG,
    RotationCode.KUKA_ABC: Format.KUKA_ABC_DEG,
    RotationCode.ZYZ: Format.ZYZ_DEG,
}
_POLICIES = {
    PolicyCode.FIXED: Policy.FIXED,
    PolicyCode.FOLLOW: Policy.FOLLOW,
    PolicyCode.REQUESTED: Policy.REQUESTED,
}
LINK_BITS = {Link.CAMERA: 1, Link.TAG_A: 2, Link.TAG_B: 4, Link.OBJECT: 8}  # DETAIL of 503
OPT_REGISTER, ORIENTATION_REGISTER = REQUEST.registers("OPT")[0], REQUEST.registers("ORI_")[0]


@dataclass(frozen=True, slots=True)
class Limits:
    """What an answer must satisfy; requests may ask for less age and less uncertainty."""

    policy: Policy
    max_age_s: float
    max_u95_mm: float
    warn_u95_mm: float
    moved_mm: float
    timeout_s: float = 2.0  # as `serving.timeout_s` of the cell file
    hold: Hold = NO_HOLD
    bounds: CellBounds = DEFAULT_BOUNDS


def check_request(request: Request, calibration: Calibration) -> Answer | None:
    """The refusal of a request that cannot be served whatever is seen, None for a good one."""
    if request.command not in (Command.EC_NEWEST, Command.EC_FRESH):
        return reply(request, Status.UNKNOWN_COMMAND, request.command)
    if target_by_id(calibration, request.point) is None:
        return reply(request, Status.UNKNOWN_POINT, request.point)
    register = _unusable_register(request, calibration)
    return None if register is None else reply(request, Status.BAD_PARAMETER, register)


def _unusable_register(request: Request, calibration: Calibration) -> int | None:
    """The request register that holds what cannot be used."""
    needs_tcp = request.wants_tcp or request.policy is PolicyCode.REQUESTED
    if needs_tcp and calibration.tcp_in_wrist is None:
        return OPT_REGISTER
    if request.unknown_options or request.rotation_format is None:
        return OPT_REGISTER
    if request.policy is PolicyCode.REQUESTED and not request.orientation_written:
        return ORIENTATION_REGISTER
    for name, number in (
        ("ROBOT", request.robot),
        ("OBJECT", request.object),
        ("TOOL", request.tool),
    ):
        if number > 1:
            return REQUEST.registers(name)[0]
    return request.reserved_register


def answer_request(
    request: Request,
    calibration: Calibration,
    calibration_id: int,
    sight: Sight,
    limits: Limits,
    now_s: float,
    now_unix_s: float,
    camera: CameraPlace = UNMOVED,
) -> tuple[Answer, ExpectedCoordinate | None]:
    """Answer a good request (`check_request`) from one evaluated picture.

    camera: where it may stand in that picture.
    Second: where the flange must be, None without a coordinate.
    """
    max_age_s = min(request.max_age_s or limits.max_age_s, limits.max_age_s)
    answer = replace(
        reply(request, Status.IDLE),
        captured_s=sight.stamp_s,
        captured_unix_us=int(1e6 * (now_unix_s - (now_s - sight.stamp_s))),
        valid_until_s=sight.stamp_s + max_age_s,
        calibration_id=calibration_id,
        tags=sum(tag is not None for tag in (sight.tag_a, sight.tag_b)),
    )
    target = target_by_id(calibration, request.point)
    if now_s >= answer.valid_until_s:
        return replace(answer, status=Status.IMAGE_TOO_OLD), None
    if request.refuse_if_moving and sight.base_from_wrist is None:
        return replace(answer, status=Status.ROBOT_MOVING), None
    if sight.tag_b is None or target is None:
        detail = calibration.facts.tag_b.id
        return replace(answer, status=Status.TAG_B_NOT_FOUND, detail=detail), None
    policy = policy_of(request, limits)
    work = requested_orientation(request) if policy is Policy.REQUESTED else None
    try:
        expected = expected_coordinate(calibration, target.name, sight.tag_b, policy, work, camera)
    except TagNotSeen:
        return replace(answer, status=_without_camera(sight)), None
    except Contradiction as err:
        detail, moved_um = (
            links_detail([Link(name) for name in err.links]),
            micrometres(err.size_mm),
        )
        drift = Status.CALIBRATION_DRIFT
        return replace(answer, status=drift, detail=detail, moved_um=moved_um), None
    except (InputError, NotObservable):
        if work is None:
            raise
        return replace(answer, status=Status.BAD_PARAMETER, detail=ORIENTATION_REGISTER), None
    if not _is_finite(expected):
        return replace(answer, status=Status.UNCERTAINTY_TOO_HIGH), None
    encoded = _encode(request, answer, expected, calibration, limits)
    tag_pose = base_from_tag(calibration, sight.tag_b, expected.taught_from_camera)
    flange = told_flange(encoded, calibration)
    excess = excess_of(calibration, target.name, flange, policy, limits.bounds, tag_pose)
    return _within(encoded, excess), expected


def policy_of(request: Request, limits: Limits) -> Policy:
    """The policy that was asked for, or else is configured."""
    return _POLICIES.get(request.policy, limits.policy)


def _within(answer: Answer, excess: Excess | None) -> Answer:
    """The answer, or the refusal of one that breaks a limit; a place that is too uncertain is not called wrong."""
    if excess is None:
        return answer
    status = LIMIT_STATUS[excess.code]
    if status is Status.OUTSIDE_CALIBRATED_VOLUME and not answer.status.is_ok:
        return answer
    return replace(answer, status=status, detail=excess.code)


def told_flange(answer: Answer, calibration: Calibration) -> Pose:
    """base_from_wrist as the numbers of a valid answer tell it to a robot."""
    rotation = rotation_from(answer.rotation, _FORMATS[answer.rotation_format])
    position = np.array(answer.position_um) / 1000
    if answer.frame is Frame.TCP and calibration.tcp_in_wrist is not None:
        position = position - rotation @ calibration.tcp_in_wrist
    return Pose(rotation, position)


def links_detail(links: Iterable[Link]) -> int:
    """DETAIL of CALIBRATION_DRIFT."""
    return sum(LINK_BITS[link] for link in links)


def micrometres(mm: float) -> int:
    """Of a length in a register, rounded up."""
    return math.ceil(1000 * mm)


def _without_camera(sight: Sight) -> Status:
    """Why a camera that may stand anywhere could not be found by tag A."""
    return Status.TAG_A_NOT_FOUND if sight.tag_a is None else Status.ROBOT_MOVING


def _is_finite(expected: ExpectedCoordinate) -> bool:
    """Whether all that is told are numbers; without one of them nothing is known."""
    numbers = (expected.u95_mm, expected.u95_rad, *expected.base_from_wrist.matrix().flat)
    return all(map(math.isfinite, numbers))


def requested_orientation(request: Request) -> Array:
    """ORI_RX, ORI_RY and ORI_RZ as base_from_wrist (3, 3)."""
    return rotation_from(request.request_orientation, _FORMATS[_format(request)])


def target_by_id(calibration: Calibration, number: int) -> Target | None:
    """The taught target with this register id."""
    for taught in calibration.taught.values():
        if taught.target.id == number:
            return taught.target
    return None


def _format(request: Request) -> RotationCode:
    return request.rotation_format or RotationCode.ROTVEC


def _encode(
    request: Request,
    answer: Answer,
    expected: ExpectedCoordinate,
    calibration: Calibration,
    limits: Limits,
) -> Answer:
    format_code = _format(request)
    pose = expected.base_from_wrist
    position: Array = pose.translation
    if request.wants_tcp and calibration.tcp_in_wrist is not None:
        position = pose.apply(calibration.tcp_in_wrist)
    if format_code is RotationCode.ROTVEC:
        a, b, c = rotvec_near(pose.rotation, calibration.taught_rotvec(expected.target.name))
    else:
        a, b, c = rotation_to(pose.rotation, _FORMATS[format_code])
    u95_um = micrometres(expected.u95_mm)
    x, y, z = (round(1000 * float(value)) for value in position)
    allowed_um = request.max_u95_um or round(1000 * limits.max_u95_mm)
    if u95_um > min(allowed_um, 1000 * limits.max_u95_mm):
        status = Status.UNCERTAINTY_TOO_HIGH
    elif expected.u95_mm > limits.warn_u95_mm:
        status = Status.OK_DEGRADED
    else:
        status = Status.OK
    return replace(
        answer,
        status=status,
        position_um=(x, y, z),
        rotation=(float(a), float(b), float(c)),
        u95_um=u95_um,
        u95_rot_10urad=math.ceil(1e5 * expected.u95_rad),
        rotation_format=format_code,
        frame=Frame.TCP if request.wants_tcp else Frame.FLANGE,
    )
