"""The command that lists the calibrations of a cell, and which of them served when."""

from pathlib import Path

import typer

from vgrd.commands.asking import ConfigOption, SocketOption
from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import InputError

_COLUMNS = ("id", "active", "made", "method", "session", "verdict", "u95 mm")


def register(app: typer.Typer) -> None:
    """Add calibrations."""
    app.command()(calibrations)


def calibrations(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """List the calibrations of the cell, which one is active, and which ones were; no daemon is needed."""
    from vgrd.solving.shelf import calibration_list
    from vgrd.store.calibrations import CalibrationStore

    result = calibration_list(CalibrationStore(_state_folder(config, socket)))
    print_result(result, json_to, _show)


def _state_folder(config: Path | None, socket: Path | None) -> Path:
    if config is not None:
        from vgrd.config.cell_file import load_config

        return Path(load_config(config).cell.state_dir)
    if socket is None:
        raise InputError("of which cell? Give --config CELL.toml or --socket PATH")
    from vgrd.commands.reloading import running_file

    return Path(running_file(socket.parent).config.cell.state_dir)


def _show(result: Result) -> None:
    keys = ("id", "active", "made", "method", "session", "verdict", "u95_mm")
    rows = [[one.get(key) for key in keys] for one in result["calibrations"]]
    console.print(table(f"calibrations in {result['folder']}", _COLUMNS, rows))
    if result["activations"]:
        columns = ("when", "calibration", "previous", "by")
        rows = [[one[key] for key in columns] for one in result["activations"]]
        console.print(table("activations", columns, rows))
