"""What `vgrd run` resolved for the gate: processes.json in the runtime folder."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from ipaddress import ip_network
from pathlib import Path
from typing import Final, TypeVar, cast

from vgrd.errors import ConfigError
from vgrd.ipc.time_limits import DEADLINE_S, REQUEST_TIMEOUT_S
from vgrd.permissions import opener
from vgrd.registers import Scale16

PROCESS_TABLE: Final = "processes.json"
WANTED_TABLE: Final = "processes.wanted.json"
CELL_KIND: Final = "cell"
START_S: Final = 60.0  # the first start compiles the hot loops: 30 s of a core

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process. hang_s: so long without progress it is killed, None: not watched.

    start_s: how long it may take to its first sign of health.
    """

    name: str
    argv: tuple[str, ...]
    kind: str = "device"
    env: Mapping[str, str] = field(default_factory=dict)
    hang_s: float | None = None
    start_s: float = START_S


@dataclass(frozen=True, slots=True)
class GateSettings:
    """The gate's part of the cell file. timeout_s: for requests that name no TMO.

    line_port: of the line server, None: there is none. int16_scale: name of a `Scale16`, the units of the
    int16 registers.
    loaded_unix_s: when the cell file was read; it names this table.
    """

    cell: str
    host: str
    port: int
    allow: tuple[str, ...]
    processes: tuple[ProcessSpec, ...]
    deadline_s: float = DEADLINE_S
    timeout_s: float = REQUEST_TIMEOUT_S
    int16_scale: Scale16 = Scale16.MRAD
    loaded_unix_s: float = 0.0
    line_port: int | None = None


def save_table(runtime_dir: Path, table: Mapping[str, object], name: str = PROCESS_TABLE) -> None:
    """Write the process table into the runtime folder, whole or not at all."""
    draft = runtime_dir / f"{name}.{os.getpid()}"
    with open(draft, "w", encoding="utf-8", opener=opener) as file:
        json.dump(table, file, indent=1)
    draft.replace(runtime_dir / name)


def load_settings(path: Path) -> GateSettings:
    """Read and check the process table. Raises ConfigError naming every fault."""
    try:
        table = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(
            str(path), [f"cannot be read: {error}; start with `vgrd run`"]
        ) from error
    faults: list[str] = []
    modbus = _take(table, "modbus", dict, faults, {})
    settings = GateSettings(
        cell=_take(table, "cell", str, faults, ""),
        host=_take(modbus, "host", str, faults, ""),
        port=_take(modbus, "port", int, faults, 0),
        allow=tuple(_take(modbus, "allow", list, faults, [])),
        processes=tuple(
            _process(row, faults) for row in _take(table, "processes", list, faults, [])
        ),
        deadline_s=_take(table, "deadline_s", float, faults, DEADLINE_S, optional=True),
        timeout_s=_take(table, "timeout_s", float, faults, REQUEST_TIMEOUT_S, optional=True),
        int16_scale=_scale(table, faults),
        loaded_unix_s=_take(table, "loaded_unix_s", float, faults, 0.0, optional=True),
        line_port=_line_port(modbus, faults),
    )
    for entry in settings.allow:
        _check(ip_network, entry, f"modbus.allow: {entry!r} is no address or network", faults)
    names = [process.name for process in settings.processes]
    faults += [f"processes: {name!r} twice" for name in set(names) if names.count(name) > 1]
    if sum(process.kind == CELL_KIND for process in settings.processes) > 1:
        faults.append("processes: more than one of kind 'cell'")
    if faults:
        raise ConfigError(str(path), faults)
    return settings


def _process(row: object, faults: list[str]) -> ProcessSpec:
    table = row if isinstance(row, dict) else {}
    name = _take(table, "name", str, faults, "")
    argv = _take(table, "argv", list, faults, [])
    if not argv or not all(isinstance(word, str) for word in argv):
        faults.append(f"processes: {name!r}: argv must be a list of words")
    hang_s = table.get("hang_s")
    return ProcessSpec(
        name=name,
        argv=tuple(argv),
        kind=_take(table, "kind", str, faults, "device", optional=True),
        env=_take(table, "env", dict, faults, {}, optional=True),
        hang_s=None if hang_s is None else _take(table, "hang_s", float, faults, 0.0),
        start_s=_take(table, "start_s", float, faults, START_S, optional=True),
    )


def _line_port(table: Mapping[str, object], faults: list[str]) -> int | None:
    return None if table.get("line_port") is None else _take(table, "line_port", int, faults, 0)


def _scale(table: object, faults: list[str]) -> Scale16:
    name = _take(table, "int16_scale", str, faults, "mrad", optional=True)
    try:
        return Scale16[name.upper()]
    except KeyError:
        known = ", ".join(scale.name.lower() for scale in Scale16)
        faults.append(f"int16_scale: {name!r}, not one of {known}")
        return Scale16.MRAD


def _take(
    table: object,
    key: str,
    kind: type[T],
    faults: list[str],
    default: T,
    *,
    optional: bool = False,
) -> T:
    """Value of `key`, or `default` with a fault noted when it is missing or of another type."""
    entries = table if isinstance(table, dict) else {}
    if key not in entries:
        if not optional:
            faults.append(f"{key}: missing")
        return default
    value = entries[key]
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return cast(T, float(value))
    if not isinstance(value, kind) or isinstance(value, bool):
        faults.append(f"{key}: {value!r} is not a {kind.__name__}")
        return default
    return value


def _check(parse: Callable[[str], object], text: str, fault: str, faults: list[str]) -> None:
    try:
        parse(text)
    except (ValueError, TypeError):
        faults.append(fault)
