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
        "point": "POINT",
        "undo": "UNDO",
        "retag": "RETAG",
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
OLD_PICTURE: Final = (
    "no other picture for {seconds} s: it is not so any more"  # of `assets/watchdog.js`
)
NO_SESSION: Final = "no session is open"
NOT_OPEN: Final = "no session is open; the calibration in use is verified in Result"
OLD: Final = "{value} (old)"
COMPUTING: Final = "Being computed anew: what is old is of the samples as they were before"
DISK: Final = "Disk: {free_gb:.1f} GB free; sessions take {sessions_gb:.1f} of {quota_gb:g} GB"
UNNAMED: Final = (
    "This step names no sample, so UNDO is off: look at what is odd; "
    "`vgrd undo N` takes a sample back"
)
SOLVING: Final = "solving: this takes up to a minute"
POSE: Final = "Flange in the robot's base: {position} mm, rotation vector {rotation} deg"
EXPECT: Final = "95 % error {before} mm, {after} mm after it"
DONE_OF: Final = "{done} of {of}"
ASKED: Final = "robot program last asked {ago}, last read {read}"
LASTED: Final = "{seconds} s"
DAYS: Final = "{days} d {time}"
AGO: Final = "{time} ago"
IN_USE: Final = "{id} in use, made {made}, {days:.0f} days old, 95 % error {u95}"
BEAT: Final = "heartbeat of the daemon: {beat}"
ROBOT_PROGRAM: Final = "Robot program"
CALIBRATION_IN_USE: Final = "Calibration"
DEVICES: Final = "Devices"
LAST_ANSWERS: Final = "Last answers"
SEEN: Final = "tag {name} ({wanted}) seen, {side:.0f} px{small}, fits to {fit:.2f} px"
SMALL: Final = " (small: see docs/fit.md)"
NOT_SEEN: Final = "tag {name} ({wanted}) not seen"
AT_REST: Final = "arm at rest"
MOVES: Final = "arm moves"
JOB: Final = "{count} targets; tolerance {tolerance:g} mm for 95 % of the misses; plan {plan}"
NOT_IN_USE: Final = "no calibration is in use"
NOT_TOLD: Final = "nothing is known of verifications of a calibration in use"
MINUTES: Final = (
    "Operator: {minutes:.1f} min by table 4 of the paper ({steps}); clock {elapsed:.0f} min"
)
LATE: Final = (
    "the press came {seconds:.0f} s late, and the arm may stand elsewhere by now: press again"
)
STILL_BUSY: Final = "still busy with {what}: wait until it is done, and press again"
NOT_HEARD: Final = "not heard yet"
SILENT: Final = "the daemon has not told this for {seconds:.0f} s"
UNTOLD: Final = "Not shown: {what}"
REFUSED: Final = "Not done: {reason}"
RECORDED: Final = "{what}: recorded as sample {sample}"
DID: Final = "{what}: done"
UNKNOWN: Final = "Still unknown"
ODD: Final = "Odd"
ACCEPTED: Final = "ACCEPTED"
REJECTED: Final = "REJECTED"
NOT_SOLVED: Final = "No session was solved yet"
LAST_RESULT: Final = "Last result"
VERIFICATION: Final = "Verification"
GOES: Final[Mapping[str, str]] = MappingProxyType(
    {"go": "✔ GO", "no go": "✖ NO GO", "open": "○ NOT VERIFIED YET"}
)
TRIALS: Final = "Verify the calibration in use"
WHERE: Final = "WHERE TO GO"
WHERE_IS: Final = (
    "{target}, by the picture of {time}. {pose}; 95 % error {u95:.2f} mm. "
    "Go there slowly, jog the rest, VERIFY"
)
TRIALS_OFF: Final = (
    "VERIFY and UNDO are off here: session {session} is open. Its own are in Teach; "
    "end it to verify what is in use"
)
REPORT: Final = "Report to print"
LIMITED: Final = "Limited by {what}. To make it better: {remedy}"
BUDGET: Final = "Share of the error's variance, %"
MAP: Final = "95 % error, mm, by turn, degrees"
NOISE: Final = "Noise, one sigma"
TOUCHES: Final = "Touches"
FOUND: Final = "What was found"
CALIBRATIONS: Final = "Calibrations"
TREND: Final = "95 % error of the worst target, mm"
TOLERANCE: Final = "tolerance"
DIFFERENCE: Final = "{chosen} against {active}, in use, for the picture of {time}"
COMPARE: Final = "COMPARE"
LIST: Final = "LIST"
SESSION: Final = "session"
TIMELINE: Final = "95 % error of each calibration, mm"
COMPARISON: Final = "Two calibrations"
BETWEEN: Final = "{second} against {first}, for the picture of {time}"
WHY: Final = "Answers by status"
LATENCY: Final = "Time to answer, ms"
CAMERA_DRIFT: Final = "Camera has moved, mm, by the hour"
MISFIT: Final = "Misfit of pictures, 1 is noise"
REQUESTS: Final = "{count} requests since the gate began"
FAULTS: Final = "Faults"
ANSWERS: Final = "Answers"
FIGURES: Final = (
    "{count} coordinates: {middle_ms} ms to answer (up to {most_ms}), "
    "95 % error {middle_mm:.3f} mm (up to {most_mm:.3f})"
)

PREDICTED: Final = "Predicted error"
PICTURE: Final = "Camera"
SAMPLES: Final = "Samples"
SCENE: Final = "The cell"
SCENE_NOTE: Final = "Where the camera stands is not known yet: only the flange is drawn"
FLANGE: Final = "flange"
GOAL: Final = "go here"
CAMERA: Final = "camera"
TAG: Final = "tag {name}"
TURN: Final = "turn"
REACHED: Final = "The flange is there"
MOVE: Final = "Move the flange by ({:.0f}, {:.0f}, {:.0f}) mm"
TURN_BY: Final = ", turn it by {:.0f} deg about ({:.2f}, {:.2f}, {:.2f}) of the base"
VIEWS: Final[Mapping[str, str]] = MappingProxyType({"left": "◀ view", "right": "view ▶"})

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
        "noise": "noise",
        "stated": "stated",
        "found": "found",
        "unit": "unit",
        "counts": "counts",
        "when": "when",
        "status": "status",
        "lasted_s": "lasted",
        "fails": "beyond chance",
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
