"""Values of the cell file that are often given in another form, each refused with what to write instead."""

import json
from contextlib import suppress
from ipaddress import ip_network
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from vgrd.config.quantities import Finite

_SQUARE = 3  # rows and columns of a camera matrix
_FLAT = 4  # the numbers of it that are not fixed: fx, fy, cx, cy


def _json_able(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings travel to the driver's process as JSON."""
    try:
        json.dumps(settings)
    except TypeError as err:
        msg = (
            "holds a date or a time, which no driver takes: write it as a text in quotes "
            f"(got {settings!r})"
        )
        raise ValueError(msg) from err
    return settings


def _four_numbers(matrix: object) -> object:
    """Refuse a camera matrix of 3 x 3, in one list or in three."""
    rows = matrix if isinstance(matrix, list) else []
    if len(rows) == _SQUARE**2:
        rows = [rows[i : i + _SQUARE] for i in range(0, _SQUARE**2, _SQUARE)]
    if len(rows) == _SQUARE and all(isinstance(row, list) and len(row) == _SQUARE for row in rows):
        (fx, _, cx), (_, fy, cy), _ = rows
        msg = f"is a 3 x 3 matrix: write [fx, fy, cx, cy], here [{fx}, {fy}, {cx}, {cy}]"
        raise ValueError(msg)
    if isinstance(matrix, list) and len(matrix) != _FLAT:
        msg = f"has {len(matrix)} entries: write four numbers in pixels, [fx, fy, cx, cy]"
        raise ValueError(msg)
    return matrix


def _not_on_the_wrist(mount: object) -> object:
    if mount == "eye-in-hand":
        msg = (
            "the daemon does not support cameras on the wrist, `vgrd solve DATASET` does: fix the camera "
            'beside the robot and write "eye-to-hand"'
        )
        raise ValueError(msg)
    return mount


def _network(entry: str) -> str:
    """Refuse what is no address and no network."""
    try:
        ip_network(entry)
    except ValueError as err:
        remedy = "write the robot's address, such as 192.168.1.10"
        with suppress(ValueError):
            remedy = f"did you mean '{ip_network(entry, strict=False)}', or one address of it?"
        msg = f"{entry!r} is no address and no network: {remedy}"
        raise ValueError(msg) from err
    return entry


Settings = Annotated[dict[str, Any], AfterValidator(_json_able)]
Matrix = Annotated[
    list[Finite],
    Field(min_length=_FLAT, max_length=_FLAT),
    BeforeValidator(_four_numbers),
]
Network = Annotated[str, AfterValidator(_network)]
no_wrist = BeforeValidator(_not_on_the_wrist)
