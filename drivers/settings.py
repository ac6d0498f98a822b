"""The `[robot.settings]`, `[camera.settings]` or `[pedal.settings]` table of a cell file as a dataclass.

The fields of the dataclass are the keys, `Annotated` with their meaning. Where it has a method `remarks`, that
tells what is wrong with the values.
"""

import dataclasses
import types
import typing
from collections.abc import Iterator
from difflib import get_close_matches
from ipaddress import IPv4Address
from typing import Annotated, TypeVar

from vgrd.devices import Setting, SettingRemark, Settings
from vgrd.errors import ConfigError

OPEN_TIMEOUT_S = 2.0  # of robots; chosen: as long as a request takes at most

T = TypeVar("T")


def parse(kind: type[T], settings: Settings, source: str) -> T:
    """Make the dataclass `kind` of `settings`; ConfigError with all faults and what is allowed.

    source: what the settings are of, for the message ("driver aravis", a file name).
    Whole numbers are taken for float fields; lists become tuples of float.
    """
    options, remarks = _examined(kind, settings)
    faults = [f"{remark.key}: {remark.message}" for remark in remarks if remark.is_fault]
    if options is None or faults:
        raise ConfigError(source, faults)
    return options


def remarks_on(kind: type, settings: Settings) -> list[SettingRemark]:
    """What is wrong or odd with the settings of a driver whose dataclass is `kind`; nothing is opened."""
    return _examined(kind, settings)[1]


def keys_of(kind: type) -> tuple[Setting, ...]:
    """The keys that a dataclass of settings has."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return tuple(
        Setting(
            key=field.name,
            type=_type_name(_plain(hints[field.name])),
            is_required=field.default is dataclasses.MISSING,
            default=None if field.default is dataclasses.MISSING else field.default,
            meaning=_meaning(hints[field.name]),
        )
        for field in dataclasses.fields(kind)
    )


def host_remark(key: str, host: str | None) -> Iterator[SettingRemark]:
    """A fault where `host` can be no address and no name of a host."""
    example = "write the address alone, such as 192.168.1.10"
    if host is None:
        return
    if not host or any(mark in host for mark in " /,@"):
        yield SettingRemark(key, f"{host!r} is no host: {example}")
    elif host.count(":") == 1:
        yield SettingRemark(key, f"{host!r} holds a port: {example}")
    elif set(host) <= set("0123456789.") and not _is_address(host):
        yield SettingRemark(
            key, f"{host!r} is no IP address: it has four numbers of at most 255, as 192.168.1.10"
        )


def _examined(kind: type[T], settings: Settings) -> tuple[T | None, list[SettingRemark]]:
    """The dataclass, None where its fields cannot be filled, and what is to be said of it."""
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = typing.get_type_hints(kind)
    remarks = [
        SettingRemark(key, f"unknown key{_hint(key, list(fields))}")
        for key in settings
        if key not in fields
    ]
    values: dict[str, object] = {}
    for name, field in fields.items():
        if name in settings:
            try:
                values[name] = _convert(settings[name], hints[name])
            except ValueError as error:
                remarks.append(SettingRemark(name, str(error)))
        elif field.default is dataclasses.MISSING:
            remarks.append(SettingRemark(name, "is missing, add it"))
    if remarks:
        return None, remarks
    options = kind(**values)
    of_values = getattr(options, "remarks", None)
    return options, [] if of_values is None else list(of_values())


def _hint(key: str, known: list[str]) -> str:
    close = get_close_matches(key, known, n=1)
    likely = f", did you mean {close[0]!r}?" if close else ""
    return f"{likely}; known: {', '.join(sorted(known))}"


def _is_address(text: str) -> bool:
    try:
        IPv4Address(text)
    except ValueError:
        return False
    return True


def _convert(value: object, hint: object) -> object:
    """`value` as `hint` (str, int, float, bool, tuple[float, ...], or one of them or None)."""
    hint = _plain(hint)
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"expected a list of numbers, got {value!r}")
        return tuple(_convert(item, float) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not hint:
        raise ValueError(f"expected {_type_name(hint)}, got {value!r}")
    return value


def _plain(hint: object) -> object:
    """A type without its meaning and without None."""
    if typing.get_origin(hint) is Annotated:
        return _plain(typing.get_args(hint)[0])
    if isinstance(hint, types.UnionType):
        return next(one for one in typing.get_args(hint) if one is not type(None))
    return hint


def _type_name(hint: object) -> str:
    is_list = typing.get_origin(hint) is tuple
    return "list of float" if is_list else str(getattr(hint, "__name__", hint))


def _meaning(hint: object) -> str:
    meanings = getattr(hint, "__metadata__", ())
    return str(meanings[0]) if meanings else ""
