"""What people do at each status: written as docs/status-codes.md by `python -m vgrd.registers.remedies FILE`.

What a robot program does is not told here.
"""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from vgrd.registers.codes import RESERVED, Status


class Remedy(NamedTuple):
    """operator: who works with the cell. integrator: who built it, where that does not help."""

    operator: str
    integrator: str


_NOTHING: Final = "nothing"
REMEDIES: Final[Mapping[str, Remedy]] = {
    "IDLE": Remedy(_NOTHING, _NOTHING),
    "OK": Remedy(_NOTHING, _NOTHING),
    "OK_DEGRADED": Remedy(
        "Go on; tell the integrator when it comes often.",
        "`vgrd advise` tells which sample narrows it most, `vgrd budget` where it comes from;"
        " `[serving] warn_u95_mm` is the limit.",
    ),
    "BUSY": Remedy("Wait.", "Longer than TMO it ends with 106."),
    "UNKNOWN_COMMAND": Remedy(
        "Call the integrator: the robot program is wrong.", "Write 1, 2 or 4 into CMD."
    ),
    "UNKNOWN_POINT": Remedy(
        "Choose another part, or call the integrator.",
        "POINT must be the `id` of a target that was touched: teach it, `vgrd solve`, `vgrd activate`.",
    ),
    "BAD_PARAMETER": Remedy(
        "Call the integrator: the robot program is wrong.",
        "DETAIL is the register: see DETAIL in registers.md.",
    ),
    "SUPERSEDED": Remedy(
        "Start again. If it comes back, call the integrator.",
        "Somebody else asked before the answer was there: one program asks at a time.",
    ),
    "TIMEOUT": Remedy(
        "Start again. If it comes back, call the integrator.",
        "Give TMO or `[serving] timeout_s` twice the time of one picture; look for a load on the"
        " computer (`top`) and the network of the camera (`journalctl -u vgrd`).",
    ),
    "CAMERA_OFFLINE": Remedy(
        "Look at the camera's cable and lamp; start again when `vgrd status` says camera ok.",
        "`vgrd status` and `journalctl -u vgrd` give the driver's words; address, MTU, firewall and"
        " a second program at the camera: service.md.",
    ),
    "GRAB_TIMEOUT": Remedy(
        "Start again. If it comes back, as 201.",
        "Pictures are lost on the way: jumbo frames and receive buffers, service.md; exposure longer than the period?",
    ),
    "IMAGE_TOO_OLD": Remedy(
        "Start again; between answer and work the robot waited too long.",
        "Let the program ask again before its last leg; `[serving] max_age_s` is the limit.",
    ),
    "OBJECT_MOVED": Remedy(
        "Put the part at rest, then start again.",
        "It turned or shook, or `[serving] moved_mm` is below the noise of the pictures.",
    ),
    "TAG_A_NOT_FOUND": Remedy(
        "Clean the tag at the flange; turn the wrist so that the camera sees it; start again.",
        '`stability = "movable"` wants both tags in each picture: choose the pose of the picture so.',
    ),
    "TAG_B_NOT_FOUND": Remedy(
        "Put the part in view with its tag up, free of hands, chips and glare; start again.",
        "DETAIL is the tag's id: compare it with `[tags.b]`; look at light, focus, size of the tag.",
    ),
    "OUTSIDE_CALIBRATED_VOLUME": Remedy(
        "Put the part into its place properly, as it was taught; start again.",
        "DETAIL names the limit: was the part lifted, or its tag put elsewhere? Teach there too, or widen"
        " `volume_margin_mm` (limits.md).",
    ),
    "ROBOT_OFFLINE": Remedy(
        "Look whether the robot is on and its network cable is in; start again.",
        "`vgrd status` gives the driver's words; address and interface of the controller, a firewall.",
    ),
    "ROBOT_MOVING": Remedy(
        "Start again. If it comes back, call the integrator.",
        "Let the program stop and wait a moment before it asks.",
    ),
    "TCP_OFFSET_CHANGED": Remedy(
        "Put the right tool and its TCP back on the pendant, then `vgrd confirm`.",
        "A new tool is taught anew; a TCP that the program sets must be the taught one while it asks.",
    ),
    "ROBOT_SAFETY_STOP": Remedy(
        "Clear the stop at the robot as you are instructed to, then start again.",
        "Find what stopped it; vgrd only reports it.",
    ),
    "NOT_CALIBRATED": Remedy(
        "The object is not taught: teach it, or call the integrator.",
        "`vgrd status` says why. Put one in use: `vgrd activate cal-000001`; damaged: `vgrd restore`, or teach.",
    ),
    "CALIBRATION_DRIFT": Remedy(
        "Do not work on. `vgrd status` names what moved: put it back as it was, then `vgrd confirm`.",
        "DETAIL and MOVED tell what and how far. A small slip of a tag: `vgrd confirm --accept 'tag B'`"
        " and `vgrd verify P1`; else teach again.",
    ),
    "UNCERTAINTY_TOO_HIGH": Remedy(
        "Turn the part towards the camera, start again; else call the integrator.",
        "`vgrd budget` tells where it comes from; MAXU95 or `[serving] max_u95_mm` is the limit.",
    ),
    "CALIBRATION_MISMATCH": Remedy(
        "Call the integrator: somebody changed the cell file.",
        "`vgrd status` names the facts that differ: undo the change (`vgrd reload`), or teach again.",
    ),
    "OUT_OF_WORKSPACE": Remedy(
        "Put the part where the robot may go; start again.",
        "DETAIL names the limit (limits.md): is the part misplaced, or are they too narrow?",
    ),
    "ENCODING_OVERFLOW": Remedy(
        "Call the integrator.",
        "DETAIL is the axis. Read ECF or EC32, or another `[serving] int16_scale`.",
    ),
    "POINT_NOT_VISIBLE": Remedy(
        "Turn the part so that the point faces the robot; start again.",
        "The tool would come from the wrong side: is the part upside down, the policy wrong (limits.md)?",
    ),
    "UNREACHABLE": Remedy(
        "Turn or move the part as it was taught; start again.",
        "DETAIL names the limit: flange or wrist would go farther from the taught pose than it allows (limits.md).",
    ),
    "INTERNAL_ERROR": Remedy(
        "Wait half a minute, start again. If it comes back, call the integrator.",
        "A process of the daemon ended and was started again: `journalctl -u vgrd` holds its last words; report them.",
    ),
    "STARTING": Remedy(
        "Wait; a start takes seconds, the first one a minute.",
        "Longer: `systemctl status vgrd`, `journalctl -u vgrd`.",
    ),
    "SHUTTING_DOWN": Remedy(
        "Wait until it runs again; somebody stops or updates the daemon.",
        "`systemctl start vgrd`.",
    ),
    "CONFIG_ERROR": Remedy(
        "Call the integrator: the cell file has a fault.",
        "`vgrd check /etc/vgrd/cell.toml` tells all of them; then `systemctl restart vgrd`.",
    ),
}
_GROUPS: Final = (  # first code of each, and its title
    (0, "At work"),
    (100, "The request"),
    (200, "Camera, picture, part"),
    (300, "Tags in the picture"),
    (400, "Robot"),
    (500, "Calibration"),
    (600, "The coordinate"),
    (900, "The daemon"),
)
_INTRODUCTION = """\
# What to do at which status

Generated from `vgrd/registers/remedies.py` by `python -m vgrd.registers.remedies docs/status-codes.md`.

For people. What the codes mean to a robot program: [registers.md](registers.md). "Start again" is to let the
robot program ask again, from its beginning, once nobody is in the cell. `vgrd status` tells the reason in words, and
`journalctl -u vgrd` what happened before. At every code but those "at work" the robot stops; no code makes it safe to
reach in.

A status that is not listed: stop, and call the integrator.
"""


def document() -> str:
    """Return the text of docs/status-codes.md."""
    starts = [first for first, _ in _GROUPS]
    ends = [*starts[1:], 1000]  # all codes have three digits
    lines = [_INTRODUCTION]
    for (first, title), end in zip(_GROUPS, ends, strict=True):
        codes = [status for status in Status if first <= status < end]
        lines += [f"## {title}", "", *_rows(codes), ""]
    return "\n".join(lines)


def _rows(codes: Iterable[Status]) -> Iterable[str]:
    yield "| status | meaning | operator | integrator |"
    yield "| --- | --- | --- | --- |"
    for code in codes:
        remedy = REMEDIES[code.name]
        yield f"| {int(code)} {code.name} | {code.description} | {remedy.operator} | {remedy.integrator} |"


def superfluous() -> set[str]:
    """Names of remedies for what is neither a status nor the name of a reserved one."""
    reserved = {why.partition(":")[0] for why in RESERVED[Status].values()}
    return set(REMEDIES) - set(Status.__members__) - reserved


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
