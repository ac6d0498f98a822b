"""What a robot program decides from what it reads: the one table behind every program in config/robot_programs.

Each row has a word that every language's program writes where it takes the decision, and a number for
languages that report numbers. `program_document` writes docs/robot-programs.md from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from vgrd.registers.codes import Status


class Reaction(StrEnum):
    """What a program does when a condition does not hold; when all hold it uses the coordinate."""

    ASK_AGAIN = "ask again"
    STOP = "stop"
    BY_STATUS = "by STATUS"


class Phase(StrEnum):
    """When a decision is taken, in this order."""

    START = "once, before anything moves"
    ASK = "each time it asks"
    ACCEPT = "before an answer is used"
    MOVE = "while the arm moves"
    AFTER = "when something did not hold"


@dataclass(frozen=True, slots=True)
class Decision:
    """One row: `holds` is the condition; `otherwise` what happens where it does not hold."""

    number: int
    word: str
    phase: Phase
    reads: str
    holds: str
    otherwise: Reaction
    why: str


@dataclass(frozen=True, slots=True)
class Limit:
    """A number that the conditions name, the same in every program until its user changes it."""

    word: str
    value: float
    unit: str
    why: str


_AGAIN, _STOP = Reaction.ASK_AGAIN, Reaction.STOP
_START, _ASK, _ACCEPT, _MOVE, _AFTER = Phase

# Numbers are told to PLCs and pendants: a row keeps its number, a new row takes the next free one.
DECISIONS: Final = (
    Decision(
        1,
        "LINK",
        _START,
        "the connection, and each later read",
        "it opens, and no answer to a read is older than LINK_S",
        _STOP,
        "what is read from a dead connection is what was read last",
    ),
    Decision(
        2,
        "MAP_VERSION",
        _START,
        "MAPVER",
        "MAPVER is 256 (0x0100)",
        _STOP,
        "another map may hold other values at the same addresses",
    ),
    Decision(
        3,
        "HEARTBEAT",
        _START,
        "HB; from then on at each read",
        "HB has changed within HEARTBEAT_S",
        _STOP,
        "something between may go on answering with registers of a daemon that is dead",
    ),
    Decision(
        4,
        "TRIG",
        _ASK,
        "the TRIG written last; at the start 0 is written, which clears",
        "all parameters first or in the same write, TRIG = last + 1, after 65535 comes 1",
        _STOP,
        "0 clears, and an equal TRIG starts nothing: the answer would be the old one",
    ),
    Decision(
        5,
        "ECHO",
        _ASK,
        "ECHO, until it is TRIG and STATUS is not 10 (BUSY)",
        "it comes within ANSWER_S",
        _AGAIN,
        "an answer to an earlier TRIG is an answer to another question",
    ),
    Decision(
        6,
        "POINT",
        _ACCEPT,
        "POINT, OBJECT",
        "both are those that were asked for",
        _STOP,
        "somebody else writes the same request registers",
    ),
    Decision(
        7,
        "STATUS",
        _ACCEPT,
        "STATUS, and EC32_STATUS of the block that is read",
        "1, or 2 where the user allows it",
        Reaction.BY_STATUS,
        "no other status comes with a coordinate",
    ),
    Decision(
        8,
        "FORMAT",
        _ACCEPT,
        "FMT b0-4",
        "the rotation format and the frame are those that were asked for (0: rotation vector, flange)",
        _STOP,
        "the same six numbers are another pose in another format",
    ),
    Decision(
        9,
        "SEQ",
        _ACCEPT,
        "SEQ, EC32_SEQ, EC32_ECHO; EC32_CRC where the language has CRC-32",
        "SEQ is even and EC32_SEQ equals it, EC32_ECHO is TRIG; read singly: before and after alike; the CRC is right",
        _AGAIN,
        "the six numbers would be of two answers, or of none",
    ),
    Decision(
        10,
        "SENTINEL",
        _ACCEPT,
        "the six numbers of the coordinate",
        "none is a sentinel (0x80000000; 0x8000; NaN)",
        _STOP,
        "a sentinel beside a good STATUS is a fault of whoever passed it on",
    ),
    Decision(
        11,
        "AGE",
        _ACCEPT,
        "AGE",
        "AGE is at most AGE_MS",
        _AGAIN,
        "the object may have moved since the picture",
    ),
    Decision(
        12,
        "U95",
        _ACCEPT,
        "U95P",
        "U95P is at most U95_UM",
        _STOP,
        "asking again does not make it more certain; 65535 is more or unknown",
    ),
    Decision(
        13,
        "BOX",
        _ACCEPT,
        "X, Y, Z",
        "each lies in the box that the user taught",
        _STOP,
        "an arm must not go where nobody has taken it by hand",
    ),
    Decision(
        14,
        "STEP",
        _ACCEPT,
        "the coordinate and the taught pose",
        "at most STEP_MM away and STEP_DEG turned, the turn taken of rotations, not number by number",
        _STOP,
        "a rotation vector near pi changes its sign, and the wrist is the same",
    ),
    Decision(
        15,
        "REACH",
        _ACCEPT,
        "the robot's own kinematics, from the taught joints",
        "the coordinate and the approach point can be reached",
        _STOP,
        "an arm that turns its elbow over on the way meets the part or itself",
    ),
    Decision(
        16,
        "APPROACH",
        _MOVE,
        "the coordinate shifted back along tool z by APPROACH_MM",
        "the arm stands there when the leg has ended, and at the coordinate after the last",
        _STOP,
        "the last leg is along the tool; something else may have ended a motion",
    ),
    Decision(
        17,
        "ASK_AGAIN",
        _MOVE,
        "a second answer, at the approach point",
        "it is accepted as the first was, and at most AGREE_MM and AGREE_DEG from it; it is used",
        _AGAIN,
        "the part may have been pushed while the arm came: by the approach point of the newer answer",
    ),
    Decision(
        18,
        "POLL",
        _MOVE,
        "every POLL_S: LINK, HEARTBEAT, STATUS, ECHO, EC32_SEQ",
        "all hold as when the answer was accepted, EC32_SEQ is the same number",
        _STOP,
        "an answer that has ended never comes back",
    ),
    Decision(
        19,
        "STOP",
        _AFTER,
        "whether the arm moves",
        "the motion is ended first, then the arm is braked; nothing else is commanded until it stands",
        _STOP,
        "two commands of motion at once are a fault of their own on most controllers",
    ),
    Decision(
        20,
        "RETREAT",
        _AFTER,
        "whether it was in the last leg",
        "back along the straight line on which it came, to the approach point, slowly",
        _STOP,
        "the way it came is the only one that is known to be free",
    ),
    Decision(
        21,
        "RESUME",
        _AFTER,
        "one key of the operator",
        "nothing moves before it, and then the program begins by asking",
        _STOP,
        "where the program stopped something was not as it was taught: somebody looks",
    ),
)

LIMITS: Final = (
    Limit("LINK_S", 0.2, "s", "a gate that lives answers in milliseconds"),
    Limit(
        "HEARTBEAT_S",
        0.5,
        "s",
        "HB moves each 0.1 s, and the daemon itself bears a pause of 0.25 s before it tells STATUS 900: below 0.45 s "
        "arms would stop for nothing, or under the wrong word",
    ),
    Limit(
        "ANSWER_S", 3.0, "s", "beyond the daemon's own 2 s (TMO 0): then it does not answer at all"
    ),
    Limit("POLL_S", 0.05, "s", "at 50 mm/s the arm goes 2.5 mm between two polls"),
    Limit("AGE_MS", 1000, "ms", "twice what a fresh answer takes (0.5 s)"),
    Limit("U95_UM", 1000, "um", "as the cell file's max_u95_mm"),
    Limit("STEP_MM", 50, "mm", "to be taught: how far the part may lie from where it was taught"),
    Limit("STEP_DEG", 20, "deg", "to be taught: how far it may be turned"),
    Limit("APPROACH_MM", 50, "mm", "clear of the part, and tag B still seen by the camera"),
    Limit(
        "AGREE_MM",
        0.5,
        "mm",
        "more than two answers differ by chance, less than a part that was pushed",
    ),
    Limit("AGREE_DEG", 0.5, "deg", "idem"),
    Limit(
        "ATTEMPTS", 3, "", "what passes by itself passes within three answers; then somebody looks"
    ),
    Limit("PAUSE_S", 0.5, "s", "leaves the daemon the time of an answer before it is asked again"),
)

# Which STATUS passes by itself, and why it does or does not; what people do is told elsewhere. A
# status that is not here stops a program: a later version may use it.
STATUS_REACTIONS: Final[Mapping[int, tuple[Reaction, str]]] = {
    Status.IDLE: (_AGAIN, "the answer was dropped, or the daemon started anew"),
    Status.BUSY: (_AGAIN, "an answer that takes longer than ANSWER_S may come next time"),
    Status.UNKNOWN_COMMAND: (_STOP, "the program asks for what is not there"),
    Status.UNKNOWN_POINT: (_STOP, "the program asks for what is not there"),
    Status.BAD_PARAMETER: (_STOP, "the program asks wrongly; DETAIL names the register"),
    Status.SUPERSEDED: (_STOP, "another client asks the same daemon: somebody looks which may"),
    Status.TIMEOUT: (_AGAIN, "a busy machine has time again"),
    Status.CAMERA_OFFLINE: (_AGAIN, "a camera or its process comes back within seconds"),
    Status.GRAB_TIMEOUT: (_AGAIN, "the next picture may come through"),
    Status.IMAGE_TOO_OLD: (
        _AGAIN,
        "a newer picture comes; each leg must take less than max_age_s",
    ),
    Status.OBJECT_MOVED: (_AGAIN, "the next answer is for where it is now"),
    Status.TAG_A_NOT_FOUND: (_STOP, "the wrist hides its tag until it is turned"),
    Status.TAG_B_NOT_FOUND: (_AGAIN, "a hand or a chip goes away"),
    Status.OUTSIDE_CALIBRATED_VOLUME: (_STOP, "the part stays where it is"),
    Status.ROBOT_OFFLINE: (_AGAIN, "a connection comes back within seconds"),
    Status.ROBOT_MOVING: (_AGAIN, "the arm comes to rest"),
    Status.TCP_OFFSET_CHANGED: (_STOP, "a person has to say which TCP is right"),
    Status.ROBOT_SAFETY_STOP: (_STOP, "a person has to clear it"),
    Status.NOT_CALIBRATED: (_STOP, "a person has to calibrate"),
    Status.CALIBRATION_DRIFT: (_STOP, "a person has to look what moved"),
    Status.UNCERTAINTY_TOO_HIGH: (_STOP, "asking again does not make it more certain"),
    Status.CALIBRATION_MISMATCH: (_STOP, "a person has to choose a calibration"),
    Status.OUT_OF_WORKSPACE: (_STOP, "the part stays where it is"),
    Status.ENCODING_OVERFLOW: (_STOP, "the number stays too large for this block"),
    Status.POINT_NOT_VISIBLE: (_STOP, "the part stays how it lies"),
    Status.UNREACHABLE: (_STOP, "the part stays how it lies"),
    Status.INTERNAL_ERROR: (_AGAIN, "the process is started again within seconds"),
    Status.STARTING: (_AGAIN, "it passes within seconds"),
    Status.SHUTTING_DOWN: (_STOP, "somebody stops the daemon"),
    Status.CONFIG_ERROR: (_STOP, "a person has to correct the cell file"),
}
