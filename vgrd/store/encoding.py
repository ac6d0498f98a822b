"""Model values as JSON and back: exact to the last bit, strict about every key.

One pair of functions serves every frozen dataclass of `vgrd.model`; its type hints are the schema.
"""

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from vgrd.errors import Corrupt, InputError, StoreError
from vgrd.geometry import Array

T = TypeVar("T")
Json = Any  # what the json module takes and gives
Hint = Any  # a class or a form of the typing module

_SHOWN_CHARACTERS = 40  # of a wrong value in a message: enough to find it in the file
_KIND = "METHOD"  # class attribute that tells the members of a union apart, stored under "method"
_NESTED = (dict, list, tuple)
_INFINITIES = {"inf": math.inf, "-inf": -math.inf}


def canonical(data: object, *, indent: int | None = None) -> bytes:
    """Spell JSON `data` in the one way: sorted keys, ASCII, exact numbers, no needless space."""
    if indent is None:
        return "".join(_pieces(data)).encode("ascii")
    return _spelled(data, (",", ": "), indent).encode("ascii")


def _pieces(data: object) -> Iterator[str]:
    """JSON text in parts: one call of the encoder for 8 MB holds the GIL for 0.5 s."""
    if isinstance(data, dict) and any(isinstance(item, _NESTED) for item in data.values()):
        for number, key in enumerate(sorted(data)):
            yield f"{',' if number else '{'}{_spelled(key)}:"
            yield from _pieces(data[key])
        yield "}"
    elif isinstance(data, list) and any(isinstance(item, _NESTED) for item in data):
        for number, item in enumerate(data):
            yield "," if number else "["
            yield from _pieces(item)
        yield "]"
    else:
        yield _spelled(data)


def _spelled(
    data: object, separators: tuple[str, str] = (",", ":"), indent: int | None = None
) -> str:
    return json.dumps(data, sort_keys=True, separators=separators, indent=indent, allow_nan=False)


def parse(text: bytes, where: str) -> Json:
    """JSON data of `text`; raises Corrupt naming `where`."""
    try:
        return json.loads(text, parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise Corrupt(
            f"{where}: not readable as JSON ({error}); restore it from a backup"
        ) from error


def encode(value: object, where: str = "value") -> Json:
    """JSON data of a model value; infinities become "inf" and "-inf".

    Raises StoreError naming what is NaN.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return _encode_float(value, where)
    if isinstance(value, np.ndarray):
        return value.tolist() if np.isfinite(value).all() else encode(value.tolist(), where)
    if isinstance(value, Mapping):
        return {key: encode(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encode(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if is_dataclass(value):
        kind = {"method": getattr(value, _KIND)} if hasattr(value, _KIND) else {}
        return kind | {
            item.name: encode(getattr(value, item.name), f"{where}.{item.name}")
            for item in fields(value)
        }
    raise TypeError(f"{where}: a {type(value).__name__} cannot be stored")


def decode(kind: type[T], data: object, where: str) -> T:
    """Value of type `kind` that `encode` turned into `data`.

    Raises Corrupt naming `where` (a file) and the key that is missing, unknown or of a wrong type.
    """
    return cast(T, _decode(kind, data, where))


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a JSON number")
    return value


def _encode_float(value: float, where: str) -> float | str:
    if math.isfinite(value):
        return value
    if math.isnan(value):
        raise StoreError(f"{where} is not a number (NaN): such a value is never stored")
    return "inf" if value > 0 else "-inf"


def _decode(kind: Hint, data: object, where: str) -> object:
    origin: Hint = get_origin(kind)
    if origin in (Union, UnionType):
        return _decode_union(kind, data, where)
    if origin is np.ndarray:
        return _decode_array(data, where)
    if origin is tuple:
        return _decode_tuple(get_args(kind), data, where)
    if origin is not None and issubclass(origin, Mapping):
        _require(data, dict, where)
        entries = cast(dict[str, object], data)
        return {
            key: _decode(get_args(kind)[1], item, f"{where}: {key}")
            for key, item in entries.items()
        }
    if is_dataclass(kind):
        return _decode_dataclass(cast(type, kind), data, where)
    if issubclass(kind, Enum):
        return _checked(kind, where, data)
    if kind is float:
        return _decode_float(data, where)
    _require(data, kind, where)
    return data


def _decode_union(kind: Hint, data: object, where: str) -> object:
    """One kind or None, or one of several dataclasses that name themselves."""
    members = [item for item in get_args(kind) if item is not NoneType]
    if data is None and len(members) < len(get_args(kind)):
        return None
    if len(members) == 1:
        return _decode(members[0], data, where)
    _require(data, dict, where)
    named = cast(dict[str, object], data).get("method")
    known = {getattr(member, _KIND): member for member in members}
    if named not in known:
        raise _wrong(named, f"one of the methods {', '.join(known)}", where)
    return _decode_dataclass(known[named], data, where)


def _decode_float(data: object, where: str) -> float:
    if isinstance(data, str) and data in _INFINITIES:
        return _INFINITIES[data]
    number = data if isinstance(data, int | float) and not isinstance(data, bool) else math.nan
    if abs(number) <= sys.float_info.max:
        return float(number)
    raise _wrong(data, "a number", where)


def _decode_array(data: object, where: str) -> Array:
    def numbers(item: object) -> object:
        return [numbers(i) for i in item] if isinstance(item, list) else _decode_float(item, where)

    _require(data, list, where)
    array = cast(Array, _checked(np.array, where, numbers(data), dtype=np.float64))
    array.setflags(write=False)
    return array


def _decode_tuple(kinds: Sequence[Any], data: object, where: str) -> tuple[object, ...]:
    _require(data, list, where)
    items = cast(list[object], data)
    if kinds[-1] is Ellipsis:
        kinds = [kinds[0]] * len(items)
    if len(kinds) != len(items):
        raise _wrong(data, f"{len(kinds)} entries", where)
    return tuple(
        _decode(kind, item, f"{where}[{i}]")
        for i, (kind, item) in enumerate(zip(kinds, items, strict=True))
    )


def _decode_dataclass(kind: type, data: object, where: str) -> object:
    _require(data, dict, where)
    entries = cast(dict[str, object], data)
    hints = _hints(kind)
    if hasattr(kind, _KIND):
        entries = {key: item for key, item in entries.items() if key != "method"}
    if missing := sorted(hints.keys() - entries.keys()):
        raise Corrupt(f"{where}: key {missing[0]!r} is missing; restore the file from a backup")
    if unknown := sorted(entries.keys() - hints.keys()):
        raise Corrupt(f"{where}: unknown key {unknown[0]!r}; known are {', '.join(hints)}")
    values = {key: _decode(hints[key], item, f"{where}: {key}") for key, item in entries.items()}
    return _checked(kind, where, **values)


@cache
def _hints(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {item.name: hints[item.name] for item in fields(kind)}


def _checked(make: Hint, where: str, *values: object, **named: object) -> object:
    """`make(...)`, its refusal turned into Corrupt naming `where`."""
    try:
        return make(*values, **named)
    except (InputError, ValueError, OverflowError) as error:
        raise Corrupt(f"{where}: {error}; restore the file from a backup") from error


def _require(data: object, kind: type, where: str) -> None:
    if not isinstance(data, kind) or (isinstance(data, bool) and kind is not bool):
        raise _wrong(data, f"a {kind.__name__}", where)


def _wrong(data: object, expected: str, where: str) -> Corrupt:
    text = repr(data)
    if len(text) > _SHOWN_CHARACTERS:
        text = f"{text[:_SHOWN_CHARACTERS]}..."
    return Corrupt(f"{where}: expected {expected}, found {text}; restore the file from a backup")
