"""Writes docs/registers.md from the declarations: `python -m vgrd.registers.document FILE`."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from vgrd.registers.codes import (
    RESERVED,
    Command,
    Frame,
    PolicyCode,
    RotationCode,
    Scale16,
    State,
    Status,
)
from vgrd.registers.layout import REQUEST, RESPONSE, SWAPPED_FROM, Block
from vgrd.registers.limits import LIMIT_STATUS, LimitCode

_INTRODUCTION = """\
# Register map v1

Generated from `vgrd/registers` by `python -m vgrd.registers.document docs/registers.md`.

Modbus TCP. Addresses are those of the protocol, from 0; PLC notation is address + 40001 (holding)
or + 30001 (input). Every unit id is answered. The response can be read as holding registers
(function 3) and as input registers (function 4). Only registers 0-31 and coils 0 and 1 can be
written. A read must lie inside one block (0-31, 100-167, 300-367), else exception 2.

Values of two or four registers come high word first at 100-167 (ABCD) and **low word first in the
copy at 300-367** (CDAB): choose the word order by the address.

## How to ask

1. Write CMD, POINT and what else is wanted, and a TRIG that differs from the one before and from
   0; in one request, or TRIG last. The same TRIG with other parameters is refused: 103, DETAIL 0.
   Before the write is answered STATE shows BUSY and the coordinates are sentinels.
   CMD, POINT, OPT and all other registers keep what was written, with one exception: policy 3
   (REQUESTED) wants registers 23-28 written anew for each request, after TRIG changed the last
   time. Else it is refused with STATUS 103, DETAIL 23: an old orientation, or none, is no wish.
2. Read 100-167 until ECHO is TRIG. While BUSY, ECHO is 0; so it is beside what was asked by a line of
   the [line server](line-server.md).
3. Use the coordinate only if STATUS is 1 (or 2), AGE is small enough, and HB has moved since a
   second ago: a client that goes on showing old registers after the daemon died shows a standing
   HB.

4. Go on reading while the arm moves, and stop it when STATUS is no longer 1 (or 2): an answer that
   has ended never comes back, ask again.

An answer stands only while the camera shows the object where the answer has it. While it stands,
pictures of the region around tag B are taken at `[camera] watch_rate_hz` (whole ones by a camera
that sends no regions). With P = 1 / watch_rate_hz and L = the time from a picture's exposure to its
evaluation, the coordinate leaves the registers

| after | within | status |
| --- | --- | --- |
| the object moved by more than `moved_mm` | P + L + 0.1 s | 206, or 302 where tag B left the region |
| the camera froze, or its network went | P + 0.1 s beyond the next picture's L | 202 or 205 |
| a process of the daemon died or stopped | 0.26 s | 201, 401, 900 |
| tag B was hidden, `hidden_tag = "invalid"` | P + L + 0.1 s | 302 |
| tag B was hidden, `hidden_tag = "hold"` | `hold_s`, or once the arm is not within `approach_mm` | 302 |

STATE shows HELD while an answer stands without its tag. `vgrd status` tells P + L + 0.1 s of the
cell that runs, as `moved_told_within_s`. P is 0.1 s by default; L was 0.03 to 0.05 s on the fake
12-megapixel cell, 0.2 s without regions. An answer is given only when two pictures agree: the one
asked for and an earlier one, or a second one. Pictures that both were taken long before the request
are not enough, also for CMD 1.

Without a valid coordinate its registers hold sentinels: 0x8000, 0x80000000, NaN. An answer expires
in the registers: past its greatest age it turns into sentinels and STATUS 205. SEQ is even while
the coordinate is valid and changes when it is not any more. A client that reads register by
register reads SEQ before and after, and takes the coordinate only if both are the same and even.

Each of the three blocks (EC16, EC32, ECF) stands for itself, with its own ECHO, STATUS and SEQ: a
coordinate too large for the int16 registers is 602 and sentinels there, with an odd EC16_SEQ, while
the others hold it and STATUS is 1. **Judge by the STATUS of the block that you read.** The units of
the int16 block are those of FMT, always; `[serving] int16_scale` in the cell file chooses them.
vgrd is not a safety function.

The coordinate is of the **flange** in the robot's base, or of the touch tip (OPT b1), never of the TCP that is
active on the pendant. A program that moves its active TCP converts: on a UR, `pose_trans(ec, get_tcp_offset())`;
`vgrd ec P1 --for BRAND` shows one in the form of a brand ([poses](poses.md)). A rotation vector is the one
nearest to how the target was taught, so that a taught box may hold RX, RY and RZ; angles of the other formats lie
within -180 to 180 degrees and are compared modulo 360.

Numbers that are missing in the tables below are reserved. A CMD that is not there is refused with
STATUS 101 and DETAIL the CMD. Write 0 into request registers that are not there: anything else is
refused with STATUS 103 and DETAIL the register. Take a STATUS that is not there as an error: a later
version may use it.
"""

_CHANGES = """\
## What changed for robot programs since 0.1

The addresses are those of before.

* Policy 3 (REQUESTED): registers 23-28 are written anew for each request, all six, after TRIG
  changed the last time; else 103 with DETAIL 23. Coil 0 does not start it: 103 with DETAIL 3.
* OPT b2 (use the pose in registers 10-21) and bits without a meaning are refused with 103, DETAIL 3.
  They were ignored.
* Registers 10-21 and 29-31 are reserved: a request with another value than 0 there is refused with
  103, DETAIL the register. They were ignored.
* CMD 3, 5 and 6 and the STATUS codes under "Reserved numbers" are not in use: no version obeyed or told
  them. The commands are refused with 101, as before; the numbers are never used for anything else.
* STATUS 305, 601, 603 and 604 are told: a coordinate beyond a limit of the cell file, or of the teaching where
  the file says nothing, is refused ([limits](limits.md)). No version told them before.
* RX, RY, RZ of a rotation vector are, of all that mean the orientation, those nearest to how the target was
  taught. They do not jump between +pi and -pi from answer to answer, and may be a little beyond them.
* CLHB (register 22) is reserved. It was never read, and a value in it is not refused.
* A coordinate too large for the int16 block is refused there alone (EC16_STATUS 602, EC16_SEQ odd),
  not in all blocks. STATUS is 1 then and DETAIL the axis: who reads EC16 judges by EC16_STATUS.
* FMT b8-15 tells the units of the int16 block in every answer, also beside sentinels.
* ECHO and STATUS belong to the very request, even when its TRIG was used before for another point;
  POINT and OBJECT are those that were asked.
* A peer may hold eight connections. One more takes the place of one that never asked, or asked once,
  or was silent for a second; one that polls is never given up.
"""


def _spans(addresses: Sequence[int]) -> str:
    """Ascending addresses as text, neighbours joined: "10-21, 29-31"."""
    firsts = [a for a in addresses if a - 1 not in addresses]
    lasts = [a for a in addresses if a + 1 not in addresses]
    return ", ".join(
        _span(first, last - first + 1) for first, last in zip(firsts, lasts, strict=True)
    )


def _span(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}-{first + count - 1}"


_DETAILS = (
    ("101", "CMD"),
    ("102", "POINT"),
    ("103", "the register that cannot be used:"),
    (
        "103",
        "3: OPT has a bit without a meaning, a rotation format that is not known, the TCP or "
        "policy 3 where no TCP is known, or policy 3 by coil 0",
    ),
    ("103", "4, 5, 6: ROBOT, OBJECT, TOOL is not 0 or 1"),
    ("103", f"{_spans(REQUEST.reserved)}: a reserved register is not 0"),
    (
        "103",
        "23: policy 3, and registers 23-28 were not all written since TRIG changed the last "
        "time, or hold no orientation",
    ),
    ("302", "id of the tag"),
    (
        "503",
        "sum of what may have moved: 1 camera, 2 tag A, 4 tag B, 8 object; 0: see `vgrd status`. "
        "MOVED tells how far, of the likeliest",
    ),
    (
        "1, 2",
        "the axis, 1-6 for X, Y, Z, RX, RY, RZ, that does not fit the int16 block: EC16_STATUS "
        "is 602 then, and only the other two blocks hold the coordinate; 0 when all hold it",
    ),
    ("602", "the axis, 1-6, that does not fit any block"),
    ("305, 601, 603, 604", "the limit that the coordinate would break, see below"),
    ("any other", "0"),
)


def document() -> str:
    """Return the text of docs/registers.md."""
    return "\n".join(
        [
            _INTRODUCTION,
            _CHANGES,
            "## Request: holding registers 0-31",
            "",
            *_block_table(REQUEST, None),
            "",
            "## Response: input and holding registers 100-167, copy 300-367",
            "",
            *_block_table(RESPONSE, SWAPPED_FROM - RESPONSE.start),
            "",
            "## Coils and discrete inputs",
            "",
            "| | address | name | meaning |",
            "|---|---|---|---|",
            "| coil | 0 | TRIG | rising edge: TRIG + 1, present parameters, not policy 3 |",
            "| coil | 1 | CLEAR | rising edge: drops the answer and the request |",
            "| discrete input | 0-15 | STATE | bits 0-15 of STATE |",
            "| discrete input | 16 | ALIVE | changes each 0.5 s while HB counts |",
            "",
            *_codes_of_detail(),
            *_limits(),
            "## STATE bits",
            "",
            *_table(("bit", "name"), ((bit.value.bit_length() - 1, bit.name) for bit in State)),
            "",
            *_codes("STATUS codes", Status),
            *_codes("CMD", Command),
            *_reserved(),
            *_codes("Rotation formats (OPT b4-7, FMT b0-3)", RotationCode),
            *_codes("Policies (OPT b8-9)", PolicyCode),
            *_codes("Frames (FMT b4)", Frame),
            *_codes("Units of the int16 block (FMT b8-15)", Scale16),
        ]
    )


def _codes_of_detail() -> list[str]:
    return ["## DETAIL", "", *_table(("with STATUS", "DETAIL"), _DETAILS), ""]


def _limits() -> list[str]:
    rows = (
        (int(code), code.name, int(LIMIT_STATUS[code]), code.description, code.key)
        for code in LimitCode
    )
    head = ("DETAIL", "name", "STATUS", "what is beyond", "keys of the limits")
    return ["## Limits (DETAIL of 305, 601, 603, 604)", "", *_table(head, rows), ""]


def _reserved() -> list[str]:
    """Numbers of the first register map that are not in use, each with the reason."""
    rows = (
        (register, number, *why.split(": ", 1))
        for register, numbers in (("STATUS", RESERVED[Status]), ("CMD", RESERVED[Command]))
        for number, why in numbers.items()
    )
    head = ("register", "number", "old name", "reserved, because")
    text = "A reserved STATUS is never sent, a reserved CMD is refused with 101."
    return ["## Reserved numbers", "", text, "", *_table(head, rows), ""]


def _table(head: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> list[str]:
    lines = [head, ("---",) * len(head), *rows]
    return ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]


def _block_table(block: Block, copy_offset: int | None) -> list[str]:
    rows: list[tuple[object, ...]] = []
    for field in block.fields:
        row: list[object] = [_span(field.address, field.count)]
        if copy_offset is not None:
            row.append(_span(field.address + copy_offset, field.count))
        rows.append((*row, field.name, field.kind, field.meaning))
    head = ["register"] if copy_offset is None else ["register", "copy"]
    return _table((*head, "name", "type", "meaning"), rows)


def _codes(
    title: str, codes: type[Status | Command | RotationCode | PolicyCode | Frame | Scale16]
) -> list[str]:
    rows = ((int(code), code.name, code.description) for code in codes)
    return [f"## {title}", "", *_table(("code", "name", "meaning"), rows), ""]


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document())
