"""From what is wanted and what is there to a list of steps. Pure: nothing is looked at or done here."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from vgrd.errors import InputError
from vgrd.installing.places import USER, Places
from vgrd.installing.steps import Answer, Command, Copy, File, Flush, Folder, Link, Removal, Step

SERVICE: Final = "vgrd.service"
SOCKET: Final = "vgrd.socket"
DEFAULT_PORT: Final = 1502  # of the cell file
PRIVILEGED: Final = 1024  # ports below it are opened by systemd, by the socket unit
PARTS: Final = (  # of the source: what is built, and what an installation needs beside it
    "vgrd",
    "drivers",
    "fakes",
    "config",
    "pyproject.toml",
    "constraints.txt",
    "README.md",
    "LICENSE",
)
_VERSION = re.compile(r"[0-9][^/]*-([1-9][0-9]*)")
_SYSUSERS = f'# Written by `vgrd install`.\nu {USER} - "vision-guided robot cell"\n'


class Units(NamedTuple):
    """Texts of the units of a version, as templates."""

    service: str
    socket: str


@dataclass(frozen=True, slots=True)
class Wish:
    """What is to be installed. source: folder of the project. version: as that says.

    cell_text: of a first cell file; is_example: it is not the user's own. python: what it shall run with.
    wheels: a folder with all packages, None: pip finds them.
    """

    source: Path
    version: str
    units: Units
    cell_text: str
    is_example: bool
    python: str
    extras: str
    wheels: Path | None = None


@dataclass(frozen=True, slots=True)
class Found:
    """What is there. versions: their names and units, half ones too. current: that of the link, "" without one.

    archived: versions before which a backup was written, also of some that are gone.
    host, port: of the cell file. state, runtime: the folders that it means. is_running: the service is.
    socket: text of the installed socket unit, "" without one. has_service: that of the service is there.
    """

    versions: Mapping[str, Units] = field(default_factory=dict)
    current: str = ""
    archived: Sequence[str] = ()
    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    state: Path = Path("/var/lib/vgrd")
    runtime: Path = Path("/run/vgrd")
    has_cell_file: bool = False
    is_running: bool = False
    socket: str = ""
    has_service: bool = False


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps. prepare: change nothing that runs. switch: go over. tidy: what is not needed any more.

    discard: after a preparation that failed. back: after a switch that failed.
    """

    prepare: tuple[Step, ...] = ()
    switch: tuple[Step, ...] = ()
    tidy: tuple[Step, ...] = ()
    discard: tuple[Step, ...] = ()
    back: tuple[Step, ...] = ()


def number_of(version: str) -> int:
    """The number behind the last dash; 0 for what is no version of ours."""
    match = _VERSION.fullmatch(version)
    return int(match[1]) if match else 0


def in_order(versions: Sequence[str]) -> list[str]:
    """Versions of ours, oldest first."""
    return sorted(filter(number_of, versions), key=number_of)


def next_version(version: str, versions: Sequence[str]) -> str:
    """Name of one more installation of `version`."""
    return f"{version}-{max(map(number_of, versions), default=0) + 1}"


def installation(places: Places, wish: Wish, found: Found) -> Plan:
    """One more version beside those that are there, and over to it."""
    # An archive is never overwritten, and outlives its version: a number that has one is taken.
    name = next_version(wish.version, [*found.versions, *found.archived])
    is_first = not found.has_cell_file
    runs = found.is_running or (not found.current and not (is_first and wish.is_example))
    go_back = _back(places, found) if found.current else ()
    half = (Removal(places.version(name)),)
    # A first cell file that is refused must not stay: it would be kept, and the mended one be ignored.
    first = (Removal(places.cell_file, wish.cell_text),) if is_first else ()
    return Plan(
        prepare=(
            *_copies(places, wish, name),
            *_environment(places, wish, name),
            *_people(places),
            *_cell_file(places, wish),
            *_cache(places, name),
            *(() if is_first and wish.is_example else (_check(places, name, is_first=is_first),)),
            _reading(places, found, name),
            *((_backup(places, name),) if found.current else ()),
            Flush(),
        ),
        switch=_switch(places, found, name, wish.units, runs=runs),
        tidy=tuple(
            Removal(places.version(old))
            for old in in_order([*found.versions])
            if old != found.current
        ),
        discard=(*half, *first),
        back=(*go_back, *half) if found.current else (),
    )


def rollback(places: Places, found: Found, wanted: str = "") -> Plan:
    """Over to the version before, or to the `wanted` one. Raises InputError where there is none."""
    others = [version for version in in_order([*found.versions]) if version != found.current]
    older = [v for v in others if number_of(v) < number_of(found.current)]
    name = wanted or (older[-1] if older else "")
    if name not in others:
        raise InputError(
            f"there is no version {name or 'before the one in use'} in {places.versions}; "
            f"beside the one in use there are: {', '.join(others) or 'none'}"
        )
    return Plan(
        prepare=(_check(places, name), _reading(places, found, name)),
        switch=_switch(places, found, name, found.versions[name], runs=found.is_running),
        back=_back(places, found),
    )


def removal(places: Places, found: Found, *, purge: bool) -> Plan:
    """Take it off the machine; cell file, state and backups stay unless `purge`."""
    units = [places.units / name for name in (SERVICE, SOCKET)]
    there = ((SERVICE, found.has_service), (SOCKET, bool(found.socket)))
    names = [name for name, is_there in there if is_there]  # none after a removal that broke off
    # A state folder of the user's own choice may hold other things: it is the user's to remove.
    data = [places.drop_ins, places.state, places.backups, places.cell_file.parent]
    ours = [*units, places.profile, places.command, places.cache]
    last = [*(data if purge else ()), places.versions]  # what runs this, as the very last
    return Plan(
        switch=(
            *(_systemctl(places, "disable", "--now", *names) if names else ()),
            *map(Removal, [*ours, places.sysusers]),
            *_systemctl(places, "daemon-reload"),
            *map(Removal, last),
        )
    )


def _copies(places: Places, wish: Wish, name: str) -> tuple[Step, ...]:
    """The source as it is now: pip builds in no folder of the user's, and the way back finds its units."""
    source = places.source(name)
    junk = ("__pycache__", "*.pyc", "*.egg-info")
    return tuple(Copy(wish.source / part, source / part, junk) for part in PARTS)


def _environment(places: Places, wish: Wish, name: str) -> tuple[Step, ...]:
    venv, source = places.version(name), places.source(name)
    offline = ("--no-index", "--find-links", str(wish.wheels)) if wish.wheels else ()
    pip = (str(venv / "bin/python"), "-m", "pip", "install", "--quiet", *offline)
    packages = ("--constraint", str(source / "constraints.txt"), f"{source}[{wish.extras}]")
    return (
        Command((wish.python, "-m", "venv", str(venv)), remedy="Debian: apt install python3-venv"),
        Command(
            (*pip, *packages),
            remedy="pip needs a package index, or a folder with all packages: --wheels DIR",
        ),
    )


def _people(places: Places) -> tuple[Step, ...]:
    """The user of the service, whose group is that of the operators."""
    makes = () if places.is_trial else (Command(("systemd-sysusers", str(places.sysusers))),)
    return (File(places.sysusers, _SYSUSERS), *makes)


def _cell_file(places: Places, wish: Wish) -> tuple[Step, ...]:
    give = () if places.is_trial else (Command(("chgrp", USER, str(places.cell_file))),)
    return (File(places.cell_file, wish.cell_text, mode=0o640, keep=True), *give)


def _cache(places: Places, name: str) -> tuple[Step, ...]:
    """Compile the hot loops now, as the service's user: the first start would take 30 s for it."""
    python = str(places.version(name) / "bin/python")
    env = {"NUMBA_CACHE_DIR": str(places.cache), "OMP_NUM_THREADS": "1"}
    if places.is_trial:
        return (Folder(places.cache), Command((python, "-m", "vgrd.vision"), env))
    folder = ("install", "-d", "-o", USER, "-g", USER, "-m", "0750", str(places.cache))
    return (
        Command(folder),
        Command(("runuser", "-u", USER, "--", python, "-m", "vgrd.vision"), env),
    )


def _check(places: Places, name: str, *, is_first: bool = False) -> Step:
    which = "the cell file that --cell names" if is_first else str(places.cell_file)
    return Command(
        (str(places.version(name) / "bin/vgrd"), "check", str(places.cell_file)),
        remedy=f"mend {which}; what runs now goes on",
    )


def _reading(places: Places, found: Found, name: str) -> Step:
    """A version that does not understand the calibration in use would serve nothing."""
    return Command(
        (str(places.version(name) / "bin/python"), "-m", "vgrd.store", str(found.state)),
        remedy=f"put the state back that this version wrote, from {places.backups}: vgrd restore",
    )


def _backup(places: Places, name: str) -> Step:
    """Of everything but the recordings, before what is new writes any of it."""
    file = str(places.archive(name))
    command = (str(places.version(name) / "bin/vgrd"), "backup", file)
    return Command((*command, "--config", str(places.cell_file)))


def _switch(
    places: Places, found: Found, name: str, units: Units, *, runs: bool
) -> tuple[Step, ...]:
    """From now on `name` is the version in use. runs: the service is started, or started anew."""
    has_socket = found.port < PRIVILEGED
    service, socket = rendered(places, units, found.host, found.port)
    socket_unit = places.units / SOCKET
    steps: list[Step] = [File(places.units / SERVICE, service)]
    if has_socket:
        steps.append(File(socket_unit, socket))
    elif found.socket:
        steps += [*_systemctl(places, "disable", "--now", SOCKET), Removal(socket_unit)]
    steps += [
        Link(places.current, places.version(name)),
        Link(places.command, places.current / "bin/vgrd"),
        File(places.profile, f"export VGRD_CONFIG={places.on_machine(places.cell_file)}\n"),
        *_systemctl(places, "daemon-reload"),
        *_systemctl(places, "enable", SERVICE, *((SOCKET,) if has_socket else ())),
    ]
    if runs:
        steps += _start(places, found, is_new_socket=has_socket and socket != found.socket)
    return tuple(steps)


def _start(places: Places, found: Found, *, is_new_socket: bool) -> list[Step]:
    """Start it anew, and see that it answers."""
    if places.is_trial:
        return []
    around = [("stop", SERVICE), ("restart", SOCKET)] if is_new_socket else []
    commands = [*around, ("restart", SERVICE)]
    steps = [step for words in commands for step in _systemctl(places, *words)]
    return [*steps, Answer(found.runtime / "control.sock")]


def _back(places: Places, found: Found) -> tuple[Step, ...]:
    units = found.versions[found.current]
    return _switch(places, found, found.current, units, runs=found.is_running)


def rendered(places: Places, units: Units, host: str, port: int) -> Units:
    """The units with their places filled in."""
    values = {
        "@VENV@": places.on_machine(places.current),
        "@CELL@": places.on_machine(places.cell_file),
        "@HOST@": f"[{host}]" if ":" in host else host,
        "@PORT@": str(port),
    }
    texts = list(units)
    for mark, value in values.items():
        texts = [text.replace(mark, value) for text in texts]
    return Units(*texts)


def _systemctl(places: Places, *words: str) -> tuple[Step, ...]:
    """A command for systemd, which a trial has not."""
    remedy = f"journalctl -u {SERVICE} tells why"
    return () if places.is_trial else (Command(("systemctl", *words), remedy=remedy),)
