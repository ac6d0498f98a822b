"""Looks at what is there: the source, its units, earlier versions, the cell file."""

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Final

from vgrd.errors import ConfigError, InputError
from vgrd.installing.places import Places
from vgrd.installing.plans import DEFAULT_PORT, SERVICE, SOCKET, Found, Units, Wish, in_order

_AT_HOME: Final = (Path("/home"), Path("/root"))  # ProtectHome= of the unit
_EXAMPLE: Final = "cell.example.toml"
_VERSION_LINE = re.compile(r'^__version__ = "([^"]+)"$', re.MULTILINE)
_BASE = "import sys; print(*sys.version_info[:2]); print(sys.base_prefix)"
_BOOTED: Final = Path("/run/systemd/system")  # sd_booted(3): there while systemd runs the machine
_OLDEST: Final = (3, 11)  # requires-python of the project


def wish_of(
    source: Path, cell: Path | None, python: str, extras: str, wheels: Path | None
) -> Wish:
    """What there is to install. Raises InputError for what is no folder of the project."""
    version = _VERSION_LINE.search(_read(source / "vgrd/__init__.py", "a folder of the project"))
    if version is None:
        raise InputError(
            f"{source}: vgrd/__init__.py tells no version; name a folder of the project"
        )
    example = _read(source / "config" / _EXAMPLE, "a folder of the project")
    return Wish(
        source=source.resolve(),
        version=version[1],
        units=_units_of(source / "config"),
        cell_text=_example_for_service(example) if cell is None else _read(cell, "a cell file"),
        is_example=cell is None,
        python=python,
        extras=extras,
        wheels=None if wheels is None else wheels.resolve(),
    )


def found_at(places: Places, cell_text: str = "") -> Found:
    """What is there. cell_text: of the cell file to be, where there is none. Raises ConfigError."""
    folders = [path for path in places.versions.glob("*-*") if path.is_dir()]
    units = {
        name: _units_of(places.version(name) / "share/vgrd/config")
        for name in in_order([p.name for p in folders])
    }
    current = places.current.readlink().name if places.current.is_symlink() else ""
    has_cell = places.cell_file.exists()
    text = _read(places.cell_file, "a cell file") if has_cell else cell_text
    host, port, state, runtime = _of_cell(text, places)
    socket_unit = places.units / SOCKET
    return Found(
        versions=units,
        current=current if current in units else "",
        archived=in_order(places.archived),
        host=host,
        port=port,
        state=state,
        runtime=runtime,
        has_cell_file=has_cell,
        is_running=not places.is_trial and _is_running(),
        socket=_read(socket_unit, "a unit") if socket_unit.exists() else "",
        has_service=(places.units / SERVICE).exists(),
    )


def check_systemd(places: Places) -> None:
    """Refuse a machine that systemd does not run, before anything is written. Raises InputError."""
    if not places.is_trial and not _BOOTED.is_dir():
        raise InputError(
            f"no systemd runs this machine ({_BOOTED} is not there), and the service needs one; without it start"
            " `vgrd run CELL.toml` by hand, or try the steps out: --root DIR"
        )


def check_python(places: Places, python: str) -> None:
    """Refuse an interpreter that is too old, or that the service would not see. Raises InputError."""
    try:
        said = subprocess.run([python, "-c", _BASE], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError(f"--python {python}: cannot be run: {error}") from error
    numbers, base = said.stdout.splitlines()
    if tuple(map(int, numbers.split())) < _OLDEST:
        raise InputError(
            f"--python {python}: is {numbers.replace(' ', '.')}, 3.11 is the oldest that will do"
        )
    hidden = any(Path(base).resolve().is_relative_to(home) for home in _AT_HOME)
    if hidden and not places.is_trial and not _shows_home(places):
        raise InputError(
            f"--python {python}: lies in {base}, which the service does not see (ProtectHome=); "
            "take that of the system: --python /usr/bin/python3"
        )


def _shows_home(places: Places) -> bool:
    """Whether the administrator changed what the service sees of homes."""
    return any("ProtectHome=" in path.read_text() for path in places.drop_ins.glob("*.conf"))


def _of_cell(text: str, places: Places) -> tuple[str, int, Path, Path]:
    """Host, port, state and runtime folder; what is missing or wrong is told by `vgrd check`, not here."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(str(places.cell_file), [f"not valid TOML: {error}"]) from error
    serving, cell = (_table(data, name) for name in ("serving", "cell"))
    host, port = serving.get("host"), serving.get("port")
    folder = places.cell_file.parent
    state, runtime = (
        str(cell.get(key) or default)
        for key, default in (("state_dir", places.state), ("runtime_dir", "/run/vgrd"))
    )
    return (
        host if isinstance(host, str) else "127.0.0.1",
        port if isinstance(port, int) else DEFAULT_PORT,
        folder / state,
        folder / runtime,
    )


def _table(data: dict[str, object], name: str) -> dict[str, object]:
    value = data.get(name)
    return value if isinstance(value, dict) else {}


def _is_running() -> bool:
    asked = ["systemctl", "is-active", "--quiet", SERVICE]
    done = subprocess.run(asked, check=False)
    return done.returncode == 0


def _example_for_service(text: str) -> str:
    """The example, its folders left to the unit."""
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith(("state_dir", "runtime_dir")))


def _units_of(folder: Path) -> Units:
    """Templates of the units; empty where an installation broke off before they were there."""
    texts = [
        path.read_text() if (path := folder / name).exists() else "" for name in (SERVICE, SOCKET)
    ]
    return Units(*texts)


def _read(path: Path, what: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}; name {what}") from error
