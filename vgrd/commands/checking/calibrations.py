"""The command that lists the calibrations of a cell, and which of them served when."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from vgrd.commands.asking import ConfigOption, SocketOption
from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import InputError, NoCurrentCalibration, StoreError

if TYPE_CHECKING:
    from vgrd.store.calibrations import CalibrationStore

_COLUMNS = ("id", "active", "made", "method", "session", "verdict", "u95 mm")


def register(app: typer.Typer) -> None:
    """Add calibrations."""
    app.command()(calibrations)


def calibrations(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """List the calibrations of the cell, which one is active, and which ones were; no daemon is needed."""
    from vgrd.store.calibrations import CalibrationStore

    store = CalibrationStore(_state_folder(config, socket))
    active = _active(store)
    result = {
        "folder": str(store.path),
        "active": active,
        "calibrations": [_row(store, name, name == active) for name in store.list()],
        "activations": [
            {
                "calibration": record.calibration,
                "previous": record.previous or None,
                "by": record.by,
                "when": _when(record.unix_s),
            }
            for record in store.activations()
        ],
    }
    print_result(result, json_to, _show)


def _state_folder(config: Path | None, socket: Path | None) -> Path:
    if config is not None:
        from vgrd.config.cell_file import load_config

        return Path(load_config(config).cell.state_dir)
    if socket is None:
        raise InputError("of which cell? Give --config CELL.toml or --socket PATH")
    from vgrd.commands.reloading import running_file

    return Path(running_file(socket.parent).config.cell.state_dir)


def _active(store: "CalibrationStore") -> str | None:
    try:
        return store.current_id()
    except NoCurrentCalibration:
        return None


def _row(store: "CalibrationStore", name: str, is_active: bool) -> dict[str, object]:
    """One calibration; a damaged file is told in its place, the others are listed all the same."""
    try:
        stored = store.load(name)
    except StoreError as err:
        return {"id": name, "active": is_active, "verdict": str(err)}
    fatal = next((one.code for one in stored.verdict.findings if one.fatal), None)
    return {
        "id": name,
        "active": is_active,
        "made": _when(stored.created_unix_s),
        "method": stored.method,
        "session": stored.session,
        "verdict": "good" if fatal is None else f"rejected: {fatal}",
        "u95_mm": stored.residuals.get("predicted_u95_mm"),
    }


def _when(unix_s: float) -> str:
    moment = datetime.fromtimestamp(unix_s, tz=UTC).astimezone()
    return moment.isoformat(sep=" ", timespec="seconds")


def _show(result: Result) -> None:
    keys = ("id", "active", "made", "method", "session", "verdict", "u95_mm")
    rows = [[one.get(key) for key in keys] for one in result["calibrations"]]
    console.print(table(f"calibrations in {result['folder']}", _COLUMNS, rows))
    if result["activations"]:
        columns = ("when", "calibration", "previous", "by")
        rows = [[one[key] for key in columns] for one in result["activations"]]
        console.print(table("activations", columns, rows))
