"""Every text of the page, once: who translates it translates this file."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

LANGUAGE: Final = "en"
TITLE: Final = "vgrd"
NO_LINK: Final = "NO LINK - nothing here is valid"

TABS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "cell": "Cell",
        "teach": "Teach",
        "result": "Result",
        "runtime": "Runtime",
        "sessions": "Sessions",
    }
)

# Of each state the word, a shape that tells it without colour, and what it means.
STATES: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "READY": ("●", "ready to answer"),
        "BUSY": ("◐", "working on a request"),
        "DEGRADED": ("▲", "answers, less certain than wanted"),
        "INVALID": ("■", "gives no coordinate"),
        "STARTING": ("○", "starting"),
    }
)

STEPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "start": "Start a session",
        "spin": "Turn the object",
        "look": "Look at tag A",
        "point": "Touch beside the object",
        "touch": "Touch a target",
        "mend": "Something is odd",
        "wait": "Wait",
        "verify": "Verify",
        "solve": "Solve",
        "activate": "Activate",
        "done": "Done",
    }
)

BUTTONS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "start": "START",
        "touch": "TOUCH",
        "verify": "VERIFY",
        "spin": "SPIN",
        "look": "LOOK",
        "undo": "UNDO",
        "solve": "SOLVE",
        "activate": "ACTIVATE",
        "rollback": "ROLL BACK",
        "stop": "END SESSION",
        "confirm": "CONFIRM",
    }
)

YOUR_TURN: Final = "Your turn"
MACHINE: Final = "The machine works"
TARGET: Final = "target"
PLAN: Final = "plan"
NAME: Final = "your name"
CALIBRATION: Final = "calibration"
NEVER: Final = "never"
NONE: Final = "none"
NO_PICTURE: Final = "no picture"
NO_SESSION: Final = "no session is open"
SOLVING: Final = "solving: this takes up to a minute"
POSE: Final = "Flange in the robot's base: {position} mm, rotation vector {rotation} deg"
EXPECT: Final = "95 % error {before} mm, {after} mm after it"
DONE_OF: Final = "{done} of {of}"
ASKED: Final = "robot program last asked {ago}, last read {read}"
AGO: Final = "{seconds:.0f} s ago"
IN_USE: Final = "{id} in use, made {made}, 95 % error {u95}"
NOT_IN_USE: Final = "no calibration is in use"
MINUTES: Final = (
    "Operator: {minutes:.1f} min by table 4 of the paper ({steps}); clock {elapsed:.0f} min"
)
LATE: Final = (
    "the press came {seconds:.0f} s late, and the arm may stand elsewhere by now: press again"
)
REFUSED: Final = "Not done: {reason}"
RECORDED: Final = "{what}: recorded as sample {sample}"
DID: Final = "{what}: done"
UNKNOWN: Final = "Still unknown"
ODD: Final = "Odd"
ACCEPTED: Final = "ACCEPTED"
REJECTED: Final = "REJECTED"
NOT_SOLVED: Final = "No session was solved since this page was opened"
TREND: Final = "95 % error of the worst target, mm"
TOLERANCE: Final = "tolerance"
DIFFERENCE: Final = "Difference to the one in use"
COMPARE: Final = "COMPARE"
WHY: Final = "Answers by status"

COLUMNS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "unix_s": "when",
        "target": "target",
        "name": "name",
        "answer": "status",
        "u95_mm": "95 % error, mm",
        "age_ms": "age, ms",
        "latency_ms": "took, ms",
        "words": "what it is",
        "sample": "sample",
        "kind": "kind",
        "remark": "remark",
        "touches": "touches",
        "off_mm": "off, mm",
        "left_out_mm": "from the others, mm",
        "reason": "suspect",
        "id": "id",
        "made": "made",
        "session": "session",
        "verdict": "verdict",
        "active": "in use",
        "plan": "plan",
        "begun": "begun",
        "samples": "samples",
        "trouble": "trouble",
        "process": "process",
        "state": "state",
        "mm": "mm",
        "deg": "deg",
        "code": "finding",
        "message": "what it says",
    }
)

# Of a page with a password (`vgrd/page/access`).
LOG_IN: Final = "LOG IN"
LOG_OUT: Final = "LOG OUT"
PASSWORD: Final = "password"  # noqa: S105  its label
ENTER: Final = "ENTER"
MAY_VIEW: Final = "You may look. To command, log in."
MAY_COMMAND: Final = "You may command. Without a command this ends in {minutes:.0f} min."
NOT_LOGGED_IN: Final = "log in first; whoever is not logged in may only look"
WRONG_PASSWORD: Final = "this is not the password"  # noqa: S105
NO_PASSWORD: Final = "the password file cannot be used; the log of the page says why"  # noqa: S105
LOCKED: Final = "too many wrong passwords; try again in {seconds} s"
TOO_MANY: Final = "too many requests from this address; wait a moment"
