"""Commands that keep the state of a cell in a file, and put it in place, on a spare computer too."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.asking import ConfigOption
from vgrd.commands.printing import JsonOption, print_result, show_fields
from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.config.cell_file import CellConfig


def register(app: typer.Typer) -> None:
    """Add backup and restore."""
    for command in (backup, restore):
        app.command()(command)


def backup(
    file: Annotated[Path, typer.Argument(help="The archive to write, such as cell.tar.")],
    sessions: Annotated[
        bool,
        typer.Option("--sessions", help="The recordings too: gigabytes, see docs/recording.md."),
    ] = False,
    config: ConfigOption = None,
    json_to: JsonOption = None,
) -> None:
    """Write calibrations, verifications, diary and cell file into one archive; the daemon may run."""
    from vgrd.backup import write_archive
    from vgrd.clock import SystemClock
    from vgrd.config.cell_file import load_config

    cell_file = _named(config)
    cell = load_config(cell_file).cell
    content = write_archive(
        file, Path(cell.state_dir), cell_file, cell.name, SystemClock(), sessions=sessions
    )
    result = {
        "file": str(file),
        "files": len(content.files),
        "megabytes": round(file.stat().st_size / 1e6, 1),
        "left_out_being_recorded": content.left_out,
    }
    print_result(result, json_to, show_fields("backup"))


def restore(
    file: Annotated[Path, typer.Argument(help="An archive of `vgrd backup`.")],
    replace: Annotated[
        bool,
        typer.Option("--replace", help="Also where what is there may be newer; it is set aside."),
    ] = False,
    config: ConfigOption = None,
    json_to: JsonOption = None,
) -> None:
    """Put calibrations and cell file of an archive in place; the daemon must be stopped."""
    from vgrd.backup import restore as put_in_place
    from vgrd.clock import SystemClock
    from vgrd.config.cell_file import load_config

    cell_file = _named(config)
    loaded = load_config(cell_file)
    with _no_daemon(loaded):
        restored = put_in_place(
            file, Path(loaded.cell.state_dir), cell_file, SystemClock(), replace=replace
        )
    created = datetime.fromtimestamp(restored.content.created_unix_s, tz=UTC).astimezone()
    result = {
        "cell": restored.content.cell,
        "backed_up": created.isoformat(sep=" ", timespec="seconds"),
        "calibration": restored.current or None,
        "set_aside": None if restored.set_aside is None else str(restored.set_aside),
    }
    print_result(result, json_to, show_fields("restored"))


def _named(config: Path | None) -> Path:
    if config is None:
        raise InputError("which cell? Give --config CELL.toml")
    return config


@contextmanager
def _no_daemon(loaded: "CellConfig") -> Iterator[None]:
    """Keep a daemon from starting meanwhile; raises AlreadyRunning where one runs."""
    from vgrd.gate.gate import LOCK_FILE, lock

    runtime = Path(loaded.cell.runtime_dir)
    if not (runtime / LOCK_FILE).exists():  # no daemon since the machine or the service started
        yield
        return
    held = lock(runtime)
    try:
        yield
    finally:
        os.close(held)
