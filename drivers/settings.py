"""The `[robot.settings]` or `[camera.settings]` table of a cell file as a dataclass."""

import dataclasses
import types
import typing
from typing import TypeVar

from vgrd.devices import Settings
from vgrd.errors import ConfigError

OPEN_TIMEOUT_S = 2.0  # of robots; chosen: as long as a request takes at most

T = TypeVar("T")


def parse(kind: type[T], settings: Settings, source: str) -> T:
    """Make the dataclass `kind` of `settings`; ConfigError with all faults and what is allowed.

    source: what the settings are of, for the message ("driver aravis", a file name).
    Whole numbers are taken for float fields; lists become tuples of float.
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = typing.get_type_hints(kind)
    faults = [
        f"unknown key {key!r}; known: {', '.join(sorted(fields))}"
        for key in settings
        if key not in fields
    ]
    values: dict[str, object] = {}
    for name, field in fields.items():
        if name in settings:
            try:
                values[name] = _convert(settings[name], hints[name])
            except ValueError as error:
                faults.append(f"{name}: {error}")
        elif field.default is dataclasses.MISSING:
            faults.append(f"{name} is missing")
    if faults:
        raise ConfigError(source, faults)
    return kind(**values)


def _convert(value: object, hint: object) -> object:
    """`value` as `hint` (str, int, float, bool, tuple[float, ...], or one of them or None)."""
    if isinstance(hint, types.UnionType):
        (hint,) = (option for option in typing.get_args(hint) if option is not type(None))
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"expected a list of numbers, got {value!r}")
        return tuple(_convert(item, float) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not hint:
        raise ValueError(f"expected {getattr(hint, '__name__', hint)}, got {value!r}")
    return value
