"""The numbers with a meaning: status codes, state bits, commands, formats.

A number that was ever told to users keeps its meaning: `RESERVED` holds those that do not work yet.
"""

from collections.abc import Mapping
from enum import IntEnum, IntFlag
from typing import Final, Self


class _Described(IntEnum):
    """A code with one line of explanation."""

    description: str

    def __new__(cls, value: int, description: str = "") -> Self:
        member = int.__new__(cls, value)
        member._value_ = value
        member.description = description
        return member


class Status(_Described):
    """STATUS: what became of the request."""

    IDLE = 0, "nothing asked"
    OK = 1, "the expected coordinate is valid"
    OK_DEGRADED = 2, "valid, less certain than the warning limit"
    BUSY = 10, "working on the request"
    UNKNOWN_COMMAND = 101, "CMD is not known"
    UNKNOWN_POINT = 102, "POINT is not taught"
    BAD_PARAMETER = 103, "a parameter cannot be used; DETAIL holds its register"
    SUPERSEDED = (
        104,
        "another request, or a clear, took its place; told by the line server, ECHO tells it here",
    )
    TIMEOUT = 106, "no answer within TMO"
    CAMERA_OFFLINE = 201, "the camera does not answer"
    GRAB_TIMEOUT = 202, "no picture in time"
    IMAGE_TOO_OLD = 205, "the picture or the answer is older than allowed"
    OBJECT_MOVED = 206, "the object moved since the answer"
    TAG_A_NOT_FOUND = (
        301,
        "the camera may be moved, and the tag on the flange that tells where is not seen",
    )
    TAG_B_NOT_FOUND = 302, "the tag on the object is not seen"
    OUTSIDE_CALIBRATED_VOLUME = (
        305,
        "the target is not where its object can take it; DETAIL tells the limit",
    )
    ROBOT_OFFLINE = 401, "the robot does not answer"
    ROBOT_MOVING = 403, "the robot moved during the exposure"
    TCP_OFFSET_CHANGED = 404, "the active TCP is not the calibrated one"
    ROBOT_SAFETY_STOP = 405, "the robot is in a safety stop"
    NOT_CALIBRATED = 501, "no calibration is active"
    CALIBRATION_DRIFT = 503, "something moved since the calibration; DETAIL tells what it may be"
    UNCERTAINTY_TOO_HIGH = 504, "less certain than MAXU95"
    CALIBRATION_MISMATCH = (
        505,
        "the calibration was made for another cell than the cell file describes",
    )
    OUT_OF_WORKSPACE = 601, "flange or tip would leave the workspace; DETAIL tells the limit"
    ENCODING_OVERFLOW = 602, "the coordinate does not fit this block; DETAIL holds the axis"
    POINT_NOT_VISIBLE = 603, "the tool would come from the wrong side; DETAIL tells the limit"
    UNREACHABLE = 604, "outside of the target's window; DETAIL tells the limit"
    INTERNAL_ERROR = 900, "the measuring process was lost"
    STARTING = 901, "the daemon is starting"
    SHUTTING_DOWN = 902, "the daemon is stopping"
    CONFIG_ERROR = 903, "the configuration has faults"

    @property
    def is_ok(self) -> bool:
        """Only OK and OK_DEGRADED come with a coordinate."""
        return self in (Status.OK, Status.OK_DEGRADED)


class State(IntFlag):
    """STATE: what the cell can do now; also discrete inputs 0-15."""

    READY = 1 << 0
    BUSY = 1 << 1
    VALID = 1 << 2
    ERROR = 1 << 3
    CAMERA_OK = 1 << 4
    ROBOT_OK = 1 << 5
    CALIBRATED = 1 << 6
    DEGRADED = 1 << 7
    AT_REST = 1 << 8
    TAG_A_SEEN = 1 << 9
    TAG_B_SEEN = 1 << 10
    HELD = 1 << 11
    SIMULATION = 1 << 15


class Command(_Described):
    """CMD: what the robot asks for."""

    EC_NEWEST = 1, "expected coordinate from the newest valid picture"
    EC_FRESH = 2, "expected coordinate from a picture taken after the request"
    CLEAR = 4, "drop the answer and whatever is being worked on"


class RotationCode(_Described):
    """How RX, RY, RZ are meant; the cell gives rad for ROTVEC and degrees for the others."""

    ROTVEC = 0, "rotation vector"
    RPY = 1, "roll, pitch, yaw about the fixed axes X, Y, Z"
    KUKA_ABC = 2, "A, B, C: Rz(A) Ry(B) Rx(C)"
    ZYZ = 3, "Euler Z, Y', Z''"


class PolicyCode(_Described):
    """How the wrist shall stand at the expected coordinate."""

    CONFIGURED = 0, "as the cell file says"
    FIXED = 1, "the target's work orientation"
    FOLLOW = 2, "the wrist turns with the object"
    REQUESTED = 3, "as ORI_RX, ORI_RY and ORI_RZ say"


class Frame(_Described):
    """What the coordinate is of."""

    FLANGE = 0, "the flange"
    TCP = 1, "the tool centre point"


class Scale16(_Described):
    """Units of the int16 block."""

    MRAD = 0, "0.1 mm and 1 mrad"
    CENTIDEGREE = 1, "0.1 mm and 0.01 deg"
    FINE = 2, "0.05 mm and 0.1 mrad"


# What was in the register map before it worked. Robot programs may know these numbers by their old
# names, so a number gets the meaning that stands here or none. It comes back to its enumeration
# together with the code that emits or obeys it.
RESERVED: Final[Mapping[type[Status | Command], Mapping[int, str]]] = {
    Status: {
        105: "NOT_ALLOWED: there are no modes that allow and forbid",
        203: "FRAME_INCOMPLETE: a damaged picture is dropped by its driver; 202 follows",
        204: "EXPOSURE_BAD: the brightness is not judged; 302 follows where it hides tag B",
        303: "POSE_AMBIGUOUS: a tag that two poses fit is not taken as seen; 302",
        304: "REPROJECTION_HIGH: a tag that does not fit its pose is not taken as seen; 302",
        306: "TAG_CLIPPED: a clipped tag is not seen; 302",
        402: "POSE_STALE: a robot whose poses stop is offline; 401",
        406: "POSE_IMPLAUSIBLE: what the robot tells of its pose is compared with no limit or step",
        502: "CALIBRATION_EXPIRED: a calibration has no greatest age",
        904: "SIMULATED: bit SIMULATION of STATE tells it beside every status",
    },
    Command: {
        3: "OBJECT_POSE: the pose of the object alone has no registers",
        5: "TAKE_SAMPLE: samples are taken through the control socket",
        6: "MARK_TOUCHED: touches are told through the control socket",
    },
}
