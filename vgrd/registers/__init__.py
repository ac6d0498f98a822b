"""The register map v1: what a robot controller reads and writes, in pure `struct`.

`layout` declares every register once; `answer` is what the cell found; `image` turns it into
registers, valid or sentinels; `document` writes docs/registers.md. Shared by the gate, the cell,
and robot programs in tests.
"""

from vgrd.registers.answer import (
    PACKED_BYTES,
    REGISTER_KIND,
    REGISTER_RING,
    Answer,
    RegisterImage,
    reply,
)
from vgrd.registers.codes import (
    Command,
    Frame,
    PolicyCode,
    RotationCode,
    Scale16,
    State,
    Status,
)
from vgrd.registers.image import View, age_ms, view
from vgrd.registers.layout import (
    MAP_VERSION,
    REQUEST,
    RESPONSE,
    SWAPPED_FROM,
    Block,
    Field,
)
from vgrd.registers.request import Request, parse_message, request_message

__all__ = [
    "MAP_VERSION",
    "PACKED_BYTES",
    "REGISTER_KIND",
    "REGISTER_RING",
    "REQUEST",
    "RESPONSE",
    "SWAPPED_FROM",
    "Answer",
    "Block",
    "Command",
    "Field",
    "Frame",
    "PolicyCode",
    "RegisterImage",
    "Request",
    "RotationCode",
    "Scale16",
    "State",
    "Status",
    "View",
    "age_ms",
    "parse_message",
    "reply",
    "request_message",
    "view",
]
