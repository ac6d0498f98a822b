"""Kalibr's target files as [target] tables of a dataset."""

from collections.abc import Mapping
from typing import Any

import yaml

from vgrd.errors import InputError

_KEYS = {  # by target_type, as Kalibr's wiki names them
    "aprilgrid": ("tagCols", "tagRows", "tagSize", "tagSpacing"),
    "checkerboard": ("targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"),
    "circlegrid": ("targetCols", "targetRows", "spacingMeters"),
}

_LONGEST = 10_000  # characters; Kalibr's have 300, its reader is slow for long ones


def kalibr_target(text: str) -> Mapping[str, object] | None:
    """The target, None where the text is no target file of Kalibr; InputError where it lacks something."""
    if "target_type" not in text or len(text) > _LONGEST:
        return None
    try:
        data = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError):
        return None
    if not isinstance(data, dict) or "target_type" not in data:
        return None
    kind = str(data["target_type"])
    if kind not in _KEYS:
        raise InputError(f"target_type '{kind}' is unknown; known: {', '.join(_KEYS)}")
    values = [_positive(data, key) for key in _KEYS[kind]]
    table: dict[str, object] = {"columns": int(values[0]), "rows": int(values[1])}
    if kind == "aprilgrid":
        return {"type": kind, **table, "size_mm": _mm(values[2]), "spacing": values[3]}
    if kind == "checkerboard":
        if values[2] != values[3]:
            raise InputError("rowSpacingMeters and colSpacingMeters differ: squares are needed")
        return {"type": "chessboard", **table, "square_mm": _mm(values[2])}
    if data.get("asymmetricGrid"):
        raise InputError(
            "asymmetricGrid: Kalibr counts its rows otherwise; write a board file with "
            'type = "asymmetric-circles"'
        )
    return {"type": "circles", **table, "spacing_mm": _mm(values[2])}


def _positive(data: Mapping[Any, Any], key: str) -> float:
    value = data.get(key)
    if not isinstance(value, int | float) or isinstance(value, bool) or not value > 0:
        raise InputError(f"{key}: {value!r}, a number above 0 is needed")
    if key.endswith(("Cols", "Rows")) and value % 1:
        raise InputError(f"{key}: {value!r}, a whole number is needed")
    return float(value)


def _mm(metres: float) -> float:
    return round(1000 * metres, 9)  # 0.028 m are 28 mm, not 28.000000000000004
