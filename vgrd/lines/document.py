"""Writes docs/line-server.md from the code: `python -m vgrd.lines.document FILE`."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

from vgrd.lines.answering import FARTHEST_MM, HB_MODULO, NO_DEG, NO_MM, UNKNOWN4, answer_text
from vgrd.lines.asking import (
    DEFAULTS,
    FIELDS,
    KUKA_DEFAULTS,
    LARGEST,
    LONGEST_DOCUMENT,
    LONGEST_LINE,
    NEEDED,
    VERB,
    Frame,
    cut,
    read,
)
from vgrd.registers import Answer, RotationCode, Status

_INTRODUCTION = f"""\
# Line server

Generated from `vgrd/lines` by `python -m vgrd.lines.document docs/line-server.md`.

For controllers without Modbus: `[serving] line_port` in the cell file opens a TCP port of ASCII lines (off by default),
at the host and for the peers of the registers. Same status codes and same answers as [the registers](registers.md);
what is said there about time, about answers that end, and about reading on while the arm moves, holds here too.
vgrd is not a safety function.

One request, exactly one answer, at once; nothing is sent unasked. A request that waits for a picture is answered
{int(Status.BUSY)} ({Status.BUSY.name}) until it is done: ask again.
"""

_MEANINGS: Final = {
    "POINT": "target point, 1-65535",
    "TRIG": "another number than the last one of this connection starts a request; the same one, with the same other "
    "fields, asks for its answer again; 0 drops the request of this connection",
    "CMD": "as the register: 1 newest picture, 2 fresh picture, 4 drops as TRIG 0 does",
    "OBJECT": "as the register, 0 = default",
    "OPT": "as the register: 0 rotation vector, 16 roll pitch yaw, 32 KUKA A B C, 48 ZYZ; + 1 not while the robot "
    "moves, + 2 the TCP; policy 3 is refused",
    "MAXAGE": "greatest age of the picture, ms, 0 = default",
    "MAXU95": "greatest uncertainty, um, 0 = default; beyond: status 504",
}

_ASKING = f"""
Decimal whole numbers, 0-{LARGEST}, no signs; blanks around a number are allowed. A field that is left out or
empty is the default. A request has at most {LONGEST_LINE} characters with its end. END is LF, CR or CR LF; the
answer ends as the request did. Blank lines are no requests.

The first request of a connection is always started. A connection that was lost has lost its request: ask with
the next TRIG. Another connection is another client: let the task that asked also ask whether the answer stands.
"""

_ANSWERING = f"""
At most {LONGEST_LINE} characters with the end (an XML document may have more). No exponents, no blanks, no plus
signs.

Use the coordinate only if TRIG is yours, STATUS is 1 (or 2), AGE is small enough, and HB has moved since a second
ago. A connection sees the answer to its own request, or none. There is one request at a time in a cell: when another
client asks or drops, or after `vgrd reload`, STATUS of yours is {int(Status.SUPERSEDED)}
({Status.SUPERSEDED.name}) from then on. In the registers, the answer to a line has ECHO 0: no program there takes it
for its own.
"""

_NUMBERS: Final = (
    ("TRIG", "1-5", "of the request; 0 where it could not be read"),
    ("STATUS", "1-3", "as in the registers"),
    ("AGE", "1-4", f"ms from mid-exposure to now; {UNKNOWN4} = more or unknown"),
    ("HB", "1-2", f"the register HB modulo {HB_MODULO}: + 1 each 100 ms"),
    (
        "X, Y, Z",
        "4-8",
        f"mm, two decimals; {NO_MM:.2f} where STATUS is not 1 or 2; farther than {FARTHEST_MM} mm: status "
        f"{int(Status.ENCODING_OVERFLOW)}",
    ),
    (
        "RX, RY, RZ",
        "5-8",
        f"**degrees**, three decimals, as OPT says, the rotation vector too; {NO_DEG:.3f} where STATUS is not 1 or 2",
    ),
    ("U95", "1-4", f"95 % uncertainty of the position, um; {UNKNOWN4} = more or unknown"),
)

_OF_CONTROLLERS = """
| controller | asks | OPT | notes |
| --- | --- | --- | --- |
| UR | `( )` | 0 | `socket_read_ascii_float(11)`; `d2r` each of RX, RY, RZ |
| KUKA | XML | 32, the default in XML | RECEIVE `Vgrd/@Echo` ... INT, `Vgrd/Ec` FRAME; SEND `Ask/@Point` ... |
| FANUC | bare | 16 | RX, RY, RZ are W, P, R |
| ABB | bare | 16 | `OrientZYX(RZ, RY, RX)`; a string of RAPID holds 80 characters |
| Yaskawa | bare | 16 | RX, RY, RZ |
| Epson | bare | 32 | RX, RY, RZ are U, V, W |
| Kawasaki | bare | 48 | RX, RY, RZ are O, A, T |
"""

_XML = f"""
XML: attributes in any order, with the names of the fields in any case, and no others; `<Ask ...></Ask>` is the same.
A document has at most {LONGEST_DOCUMENT} characters and needs no END; its answer has none. A, B, C are the three
rotations in the order of the fields: those of KUKA unless Opt says otherwise.
"""

_ERRORS: Final = (
    (f"another verb than {VERB}", f"`0,{int(Status.UNKNOWN_COMMAND)},...`"),
    (
        f"too few or too many fields, a number that is none or beyond {LARGEST}, an unknown attribute",
        f"`TRIG,{int(Status.BAD_PARAMETER)},...`, with 0 where TRIG cannot be read",
    ),
    (
        "the TRIG of the request before, with other fields",
        f"`TRIG,{int(Status.BAD_PARAMETER)},...`; the request before stands",
    ),
    (
        "bytes that are not printable ASCII, a line or a document that is too long",
        "the connection is closed (`line_garbage`)",
    ),
    (
        "a line whose end does not come within a second, answers that are not taken for so long, a minute of silence",
        "the connection is closed (`line_timeouts`)",
    ),
)

_LIMITS = """
Limits of connections are those of the registers: eight of a peer, one more takes the place of one that is silent. A
peer that sends many lines at once gets all answers, some in each turn of the daemon's loop: the registers do not wait
for it. So it is with a peer that sends many Modbus frames.

The daemon counts, beside what it counts of the registers: `line_connections`, `line_requests`, `line_exceptions`
(answered with an error as above), `line_accepted`, `line_refused`, `line_evicted`, `line_garbage`, `line_timeouts`.
"""

_ANSWER: Final = Answer(
    Status.OK,
    captured_s=0.0,
    valid_until_s=1.0,
    position_um=(412_350, -118_020, 305_100),
    u95_um=310,
)
_EXAMPLES: Final = (  # the rotation is the same in all of them
    (b"EC,1,7,,,16\n", RotationCode.RPY, (179.998, 0.012, -90.004)),
    (b"(EC,1,7)\n", RotationCode.ROTVEC, (-2.221277, 2.221432, 0.000271)),
    (b'<Ask Point="1" Trig="7"/>', RotationCode.KUKA_ABC, (-90.004, 0.012, 179.998)),
)


def document() -> str:
    """The text of docs/line-server.md."""
    return "\n".join(
        [
            _INTRODUCTION,
            "## Request",
            "",
            f"    {_grammar()} END",
            _ASKING,
            "| field | default | meaning |",
            "| --- | --- | --- |",
            *(f"| {name} | {_default(name)} | {_MEANINGS[name]} |" for name in FIELDS),
            "",
            "## Answer",
            "",
            "    TRIG,STATUS,AGE,HB,X,Y,Z,RX,RY,RZ,U95 END",
            _ANSWERING,
            "| field | characters | meaning |",
            "| --- | --- | --- |",
            *(f"| {' | '.join(row)} |" for row in _NUMBERS),
            "",
            "## Frames: an answer comes as it was asked for",
            *(line for example in _EXAMPLES for line in _example(*example)),
            _XML,
            "## Which controller asks how",
            _OF_CONTROLLERS,
            "## What is not a request",
            "",
            "| what | answer |",
            "| --- | --- |",
            *(f"| {' | '.join(row)} |" for row in _ERRORS),
            _LIMITS,
        ]
    )


def _grammar() -> str:
    """The fields in their order, what may be left out in brackets."""
    needed, optional = FIELDS[:NEEDED], FIELDS[NEEDED:]
    return (
        ",".join((VERB, *needed)) + "".join(f"[,{name}" for name in optional) + "]" * len(optional)
    )


def _default(name: str) -> str:
    if name in FIELDS[:NEEDED]:
        return "none"
    other = "" if DEFAULTS[name] == KUKA_DEFAULTS[name] else f", in XML {KUKA_DEFAULTS[name]}"
    return f"{DEFAULTS[name]}{other}"


def _example(
    request: bytes, code: RotationCode, rotation: tuple[float, float, float]
) -> list[str]:
    """A request, and its answer while it waits, and when it is there."""
    piece = cut(request)
    if piece is None:
        raise ValueError(f"not a whole request: {request!r}")
    trig, there = read(piece).trig, replace(_ANSWER, rotation=rotation, rotation_format=code)
    answers = [
        answer_text(piece.frame, trig, answer, beat, now_s)
        for answer, beat, now_s in ((Answer(Status.BUSY), 38, math.nan), (there, 41, 0.062))
    ]
    return ["", f"{_FRAME_WORDS[piece.frame]}:", "", *(f"    {t}" for t in (piece.text, *answers))]


_FRAME_WORDS: Final = {
    Frame.BARE: "Bare, with the answer while it is worked on, and when it is there",
    Frame.BRACKETS: "In brackets, as `socket_read_ascii_float` of URScript reads it",
    Frame.XML: "An XML document, as EthernetKRL of KUKA sends and reads it",
}


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
