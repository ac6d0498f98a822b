"""The three encodings of a coordinate: each stands for itself, so that one may fail alone."""

import math
from collections.abc import Sequence
from typing import Final

from vgrd.registers.answer import LARGEST32, UNKNOWN16, Answer
from vgrd.registers.codes import RotationCode, Scale16, Status

_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
_LARGEST16 = 0x7FFF  # of an i16
_LARGEST_FLOAT = 3.4e38  # a little less than the largest float32
_BEYOND = 1 << 63  # steps that no block holds
_UNITS16: Final = {  # um per step, steps per rad
    Scale16.MRAD: (100.0, 1e3),
    Scale16.CENTIDEGREE: (100.0, 100.0 * 180.0 / math.pi),
    Scale16.FINE: (50.0, 1e4),
}


def coordinates(answer: Answer, scale: Scale16) -> dict[str, float]:
    """The three blocks; each holds the coordinate or, alone, sentinels and the status why."""
    values: dict[str, float] = {}
    for name, steps, limit, nothing in (
        ("EC16", _steps16(answer, scale), _LARGEST16, -_LARGEST16 - 1),
        ("EC32", _steps32(answer), LARGEST32, -LARGEST32 - 1),
        ("ECF", _floats(answer), _LARGEST_FLOAT, math.nan),
    ):
        status = answer.status
        if status.is_ok and _axis_beyond(steps, limit):
            status = Status.ENCODING_OVERFLOW
        shown = steps if status.is_ok else (nothing,) * len(_AXES)
        values |= {f"{name}_{axis}": step for axis, step in zip(_AXES, shown, strict=True)}
        values |= {f"{name}_ECHO": answer.echo, f"{name}_STATUS": status}
        values[f"{name}_SEQ"] = sequence(answer, valid=status.is_ok)
    fits = values["EC32_STATUS"] == answer.status and answer.status.is_ok
    values["EC32_U95"] = min(answer.u95_um, LARGEST32) if fits else -LARGEST32 - 1
    values["ECF_U95"] = answer.u95_um / 1000 if answer.status.is_ok else math.nan
    return values


def sequence(answer: Answer, *, valid: bool) -> int:
    """SEQ: even while there is a coordinate."""
    return (2 * answer.seq + (not valid)) & UNKNOWN16


def narrow_axis(answer: Answer, scale: Scale16) -> int:
    """The first axis (1-6) that does not fit the int16 block, or the int32 block, else 0."""
    return _axis_beyond(_steps16(answer, scale), _LARGEST16) or _axis_beyond(
        _steps32(answer), LARGEST32
    )


def _axis_beyond(values: Sequence[float], limit: float) -> int:
    """The first axis (1-6) whose value is larger than `limit` on either side, 0 for none."""
    return next((axis for axis, value in enumerate(values, 1) if abs(value) > limit), 0)


def _steps16(answer: Answer, scale: Scale16) -> list[int]:
    um, per_rad = _UNITS16[scale]
    rotvec = answer.rotation_format == RotationCode.ROTVEC
    angles = answer.rotation if rotvec else tuple(map(math.radians, answer.rotation))
    return [round(p / um) for p in answer.position_um] + [_steps(a, per_rad) for a in angles]


def _steps32(answer: Answer) -> list[int]:
    unit = 1e6 if answer.rotation_format == RotationCode.ROTVEC else 1e4
    return [*answer.position_um, *(_steps(a, unit) for a in answer.rotation)]


def _floats(answer: Answer) -> list[float]:
    return [*(um / 1000 for um in answer.position_um), *answer.rotation]


def _steps(angle: float, unit: float) -> int:
    """Whole steps; 2^63 for what is not finite, which no block holds."""
    steps = angle * unit
    return round(steps) if math.isfinite(steps) else _BEYOND


def wide_axis(answer: Answer) -> int:
    """The first axis (1-6) that does not even fit the floats, 0 when all do."""
    return _axis_beyond(_floats(answer), _LARGEST_FLOAT)
