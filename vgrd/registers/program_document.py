"""Writes docs/robot-programs.md: `python -m vgrd.registers.program_document FILE`."""

import sys
from pathlib import Path

from vgrd.registers.codes import Status
from vgrd.registers.decisions import DECISIONS, LIMITS, STATUS_REACTIONS, Phase, Reaction
from vgrd.registers.document import table

_INTRODUCTION = """\
# What a robot program decides

Generated from `vgrd/registers/decisions.py` by
`python -m vgrd.registers.program_document docs/robot-programs.md`.

The programs in [config/robot_programs](../config/robot_programs/README.md) take these decisions, in
this order, each under its word. Who writes a program for another robot writes them all. The registers
are those of [registers.md](registers.md); a program over the line server reads the same values.

1. It asks, and accepts an answer only if every condition of "before an answer is used" holds.
2. It goes to the approach point, asks once more there, and goes the last leg along the tool.
3. All the way it goes on reading; when a condition of POLL fails it stops the arm at once.

**ask again**: nothing moves; it waits PAUSE_S and asks anew with the next TRIG, ATTEMPTS times in all,
then it stops. **stop**: STOP, then RETREAT, then it tells the word, STATUS and DETAIL, and waits for
RESUME. A program that cannot decide stops; while the arm moves every doubt is a reason to stop.

The arm is told to stop within POLL_S + 0.26 s of the moment at which the coordinate became invalid, or
HEARTBEAT_S + POLL_S where something else answers in the daemon's place. vgrd is not a safety function:
the robot's own safety limits stay as they are.
"""

_LIMITS = """\
## Limits

Each program has these numbers at its top, under the same names; a user changes them there.
"""

_STATUSES = """\
## STATUS: what a program does

A STATUS that is not here stops the program: a later version may use it.
"""


def document() -> str:
    """Return the text of docs/robot-programs.md."""
    return "\n".join(
        [
            _INTRODUCTION,
            *(line for phase in Phase for line in _decisions(phase)),
            _LIMITS,
            *table(
                ("name", "value", "why"),
                (
                    (limit.word, f"{limit.value:g} {limit.unit}".strip(), limit.why)
                    for limit in LIMITS
                ),
            ),
            "",
            _STATUSES,
            *table(("code", "name", "program", "why"), map(_status_row, Status)),
            "",
        ]
    )


def _decisions(phase: Phase) -> list[str]:
    rows = (
        (row.number, row.word, row.reads, row.holds, row.otherwise, row.why)
        for row in DECISIONS
        if row.phase is phase
    )
    head = ("number", "word", "is read or looked at", "holds when", "else", "why")
    return [f"## {phase[0].upper()}{phase[1:]}", "", *table(head, rows), ""]


def _status_row(status: Status) -> tuple[object, ...]:
    if status is Status.OK_DEGRADED:
        return int(status), status.name, "use it, or stop", f"{status.description}: the user says"
    if status is Status.OK:
        return int(status), status.name, "use it", status.description
    reaction, why = STATUS_REACTIONS.get(status, (Reaction.STOP, status.description))
    return int(status), status.name, reaction, why


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document())
