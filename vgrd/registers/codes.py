"""The numbers with a meaning: status codes, state bits, commands, formats."""

from enum import IntEnum, IntFlag
from typing import Self


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
    SUPERSEDED = 104, "a newer request took its place"
    NOT_ALLOWED = 105, "not allowed in the present mode"
    TIMEOUT = 106, "no answer within TMO"
    CAMERA_OFFLINE = 201, "the camera does not answer"
    GRAB_TIMEOUT = 202, "no picture in time"
    FRAME_INCOMPLETE = 203, "the picture is damaged"
    EXPOSURE_BAD = 204, "the picture is too dark or too bright"
    IMAGE_TOO_OLD = 205, "the picture or the answer is older than allowed"
    OBJECT_MOVED = 206, "the object moved since the answer"
    TAG_A_NOT_FOUND = 301, "the tag at the flange is not seen"
    TAG_B_NOT_FOUND = 302, "the tag on the object is not seen"
    POSE_AMBIGUOUS = 303, "two poses of a tag explain the picture"
    REPROJECTION_HIGH = 304, "the tag does not fit its pose"
    OUTSIDE_CALIBRATED_VOLUME = 305, "outside the volume that was calibrated"
    TAG_CLIPPED = 306, "a tag is cut by the picture's edge or too small"
    ROBOT_OFFLINE = 401, "the robot does not answer"
    POSE_STALE = 402, "the robot's pose is older than allowed"
    ROBOT_MOVING = 403, "the robot moved during the exposure"
    TCP_OFFSET_CHANGED = 404, "the active TCP is not the calibrated one"
    ROBOT_SAFETY_STOP = 405, "the robot is in a safety stop"
    POSE_IMPLAUSIBLE = 406, "the robot's pose jumped or is out of limits"
    NOT_CALIBRATED = 501, "no calibration is active"
    CALIBRATION_EXPIRED = 502, "the calibration is older than allowed"
    CALIBRATION_DRIFT = 503, "the cell seems to have moved since the calibration"
    UNCERTAINTY_TOO_HIGH = 504, "less certain than MAXU95"
    CALIBRATION_MISMATCH = (
        505,
        "the calibration was made for another cell than the cell file describes",
    )
    OUT_OF_WORKSPACE = 601, "the coordinate is outside the workspace"
    ENCODING_OVERFLOW = 602, "the coordinate does not fit this block; DETAIL holds the axis"
    POINT_NOT_VISIBLE = 603, "the point is on the wrong side"
    UNREACHABLE = 604, "outside the target's yaw window"
    INTERNAL_ERROR = 900, "the measuring process was lost"
    STARTING = 901, "the daemon is starting"
    SHUTTING_DOWN = 902, "the daemon is stopping"
    CONFIG_ERROR = 903, "the configuration has faults"
    SIMULATED = 904, "test data"

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
    OBJECT_POSE = 3, "pose of the object only"
    CLEAR = 4, "drop the answer and whatever is being worked on"
    TAKE_SAMPLE = 5, "take a calibration sample"
    MARK_TOUCHED = 6, "mark the touched point"


class RotationFormat(_Described):
    """How RX, RY, RZ are meant; the cell gives rad for ROTVEC and degrees for the others."""

    ROTVEC = 0, "rotation vector"
    RPY = 1, "roll, pitch, yaw about the fixed axes X, Y, Z"
    KUKA_ABC = 2, "A, B, C: Rz(A) Ry(B) Rx(C)"
    ZYZ = 3, "Euler Z, Y', Z''"


class Policy(_Described):
    """How the wrist shall stand at the expected coordinate."""

    CONFIGURED = 0, "as the cell file says"
    FIXED = 1, "the target's work orientation"
    FOLLOW = 2, "the wrist turns with the object"
    REQUESTED = 3, "as REQ_ORI says"


class Frame(_Described):
    """What the coordinate is of."""

    FLANGE = 0, "the flange"
    TCP = 1, "the tool centre point"


class Scale16(_Described):
    """Units of the int16 block."""

    MRAD = 0, "0.1 mm and 1 mrad"
    CENTIDEGREE = 1, "0.1 mm and 0.01 deg"
    FINE = 2, "0.05 mm and 0.1 mrad"
