"""The line server's language: requests and answers of controllers without Modbus, in pure functions.

`asking` cuts and reads requests, `answering` writes answers, `document` writes docs/line-server.md.
May import registers: the standard library only. Used by the gate, and by robot programs in tests.
"""

from vgrd.lines.answering import answer_text
from vgrd.lines.asking import (
    BLANKS,
    LONGEST_DOCUMENT,
    LONGEST_LINE,
    Asked,
    Frame,
    Piece,
    RefusedError,
    UnreadableError,
    cut,
    read,
)

__all__ = [
    "BLANKS",
    "LONGEST_DOCUMENT",
    "LONGEST_LINE",
    "Asked",
    "Frame",
    "Piece",
    "RefusedError",
    "UnreadableError",
    "answer_text",
    "cut",
    "read",
]
