"""A fixed script of requests and answers, and the registers that a robot reads, as JSON.

Run by `tests.behaviour` in the tree that it asks; uses nothing but the doors of `vgrd.registers`.
"""

import itertools
import json

from vgrd.registers import Answer, RegisterImage, Request, State, Status, view

DEADLINE_S = 0.25
AGES_S = (0.0, 0.2, 0.3, 2.5)
FORMATS = type(Answer().rotation_format)  # its name differs between versions
# Numbers that every version of the map has.
STATUSES = (
    0,
    1,
    2,
    10,
    101,
    102,
    103,
    106,
    201,
    202,
    205,
    206,
    302,
    401,
    403,
    501,
    504,
    505,
    602,
    900,
)


def request(trig: int, point: int) -> Request:
    """As a robot would write it."""
    registers = bytearray(64)
    registers[0:2] = trig.to_bytes(2, "big")
    registers[4:6] = point.to_bytes(2, "big")
    return Request.parse(bytes(registers), nonce=trig)


def views() -> list[dict[str, object]]:
    """The registers in every state and at several ages."""
    out: list[dict[str, object]] = []
    asked = request(3, 2)
    for status, age_s, form in itertools.product(STATUSES, AGES_S, FORMATS):
        answer = Answer(
            Status(status),
            echo=3,
            seq=7,
            nonce=3,
            point=asked.point,
            captured_s=9.5,
            captured_unix_us=1_700_000_000_000_000,
            valid_until_s=11.0,
            position_um=(123_456, -234_567, 345_678),
            rotation=(0.1, -0.2, 3.0),
            u95_um=310,
            u95_rot_10urad=42,
            tags=2,
            calibration_id=17,
            rotation_format=form,
        )
        image = RegisterImage(answer, State(0), 1234, published_s=10.0)
        for pending, answered in ((None, asked), (asked, None), (None, None)):
            seen = view(
                RegisterImage.unpack(image.pack()),
                10.0 + age_s,
                pending,
                deadline_s=DEADLINE_S,
                answered=answered,
            )
            out.append({"response": seen.response.hex(), "swapped": seen.swapped.hex()})
    return out


if __name__ == "__main__":
    print(json.dumps(views()))
