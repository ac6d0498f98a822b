"""The command that takes a changed cell file over into the running daemon, and whether it is in force."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.asking import ConfigOption, SocketOption, client_of, gate_report
from vgrd.commands.printing import JsonOption, print_result, show_fields
from vgrd.errors import (
    ConfigError,
    ControlError,
    DaemonUnreachable,
    InputError,
    NoCurrentCalibration,
    StoreError,
)

if TYPE_CHECKING:  # these load numpy or pydantic, which most commands do without
    from vgrd.config.resolved import Resolved
    from vgrd.ipc.control import ControlClient

_TAKEN_S = 20.0  # it needs a second to end the processes; a busy machine some more
_POLL_S = 0.05  # little beside the second that it needs
_RESTART = (
    "cell.",
    "serving.host",
    "serving.port",
)  # what the gate, or who started it, holds open


def register(app: typer.Typer) -> None:
    """Add reload."""
    app.command()(reload)


def reload(
    cell_file: Annotated[
        Path | None, typer.Argument(help="The changed cell file; none: that of the daemon.")
    ] = None,
    without_calibration: Annotated[
        bool,
        typer.Option(
            help="Take it over though the calibration in use does not fit it: nothing is served then."
        ),
    ] = False,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Check a changed cell file, and let the running daemon work with it.

    What it changes is started again, the port stays open, and the registers are invalid meanwhile.
    """
    from vgrd.config.cell_file import load_config
    from vgrd.config.resolved import Resolved, changed_keys, forget_resolved, save_resolved
    from vgrd.config.setup import process_table
    from vgrd.gate.settings import WANTED_TABLE, save_table

    runtime = _runtime_folder(cell_file, config, socket)
    running = _running(runtime)
    source = cell_file or Path(running.source)
    resolved = Resolved(load_config(source), str(source.resolve()), time.time())
    changed = changed_keys(running, resolved)
    _refuse_what_needs_a_restart(source, changed)
    _refuse_while_recording(client_of(None, runtime / "control.sock"))
    if not without_calibration:
        _refuse_a_calibration_that_does_not_fit(resolved)
    path = save_resolved(resolved, runtime)
    save_table(runtime, process_table(resolved, path), WANTED_TABLE)
    _wait_until_taken(runtime, resolved.loaded_unix_s)
    forget_resolved(runtime, but=path)
    result = {"cell_file": resolved.source, "changed": changed or "nothing"}
    print_result(result, json_to, show_fields("reloaded"))


def file_now(running: "Resolved") -> str:
    """In words, whether the cell file still is what the daemon works with."""
    from vgrd.config.cell_file import load_config
    from vgrd.config.resolved import Resolved, changed_keys

    source = Path(running.source)
    try:
        changed = changed_keys(running, Resolved(load_config(source), running.source, time.time()))
    except ConfigError as err:
        return f"cannot be used as it is now: {'; '.join(err.faults)}"
    if not changed:
        return "in force"
    return f"changed since, not in force: {', '.join(changed)} (take it over with vgrd reload)"


def running_file(runtime: Path) -> "Resolved":
    """The resolved file that the daemon in this runtime folder works with; raises ConfigError."""
    from vgrd.config.resolved import load_resolved
    from vgrd.gate.settings import CELL_KIND, PROCESS_TABLE, load_settings

    table = load_settings(runtime / PROCESS_TABLE)
    row = next((row for row in table.processes if row.kind == CELL_KIND), None)
    if row is None:
        raise ConfigError(str(runtime / PROCESS_TABLE), ["has no cell: start with `vgrd run`"])
    return load_resolved(Path(row.argv[-1]))


def runtime_of_daemon(config: Path | None, socket: Path | None) -> Path:
    """The runtime folder of a daemon that runs; DaemonUnreachable when none does."""
    runtime = _runtime_folder(None, config, socket)
    if gate_report(runtime) is None:
        raise DaemonUnreachable(f"no daemon runs in {runtime}.")
    return runtime


def _runtime_folder(cell_file: Path | None, config: Path | None, socket: Path | None) -> Path:
    from vgrd.config.cell_file import load_config

    if socket is not None:
        return socket.parent
    named = cell_file or config
    if named is None:
        raise InputError("which daemon? Give the cell file, --config CELL.toml or --socket PATH")
    return Path(load_config(named).cell.runtime_dir)


def _running(runtime: Path) -> "Resolved":
    """What the daemon works with; DaemonUnreachable when none runs."""
    if gate_report(runtime) is None:
        raise DaemonUnreachable(
            f"no daemon runs in {runtime}: start it with vgrd run (a new runtime_dir needs a restart)"
        )
    return running_file(runtime)


def _refuse_what_needs_a_restart(source: Path, changed: list[str]) -> None:
    fixed = [key for key in changed if key.startswith(_RESTART)]
    if fixed:
        raise InputError(
            f"{source}: {', '.join(fixed)} changed: that needs a restart of the daemon "
            "(systemctl restart vgrd, or stop vgrd run and start it again)"
        )


def _refuse_while_recording(client: "ControlClient") -> None:
    try:
        recording = client.call("status")["recording"]
    except ControlError:
        return  # a cell that does not answer records nothing, and may need the reload
    if isinstance(recording, dict) and recording.get("session"):
        raise InputError(
            f"session {recording['session']} is being recorded: stop it first (vgrd record stop)"
        )


def _refuse_a_calibration_that_does_not_fit(resolved: "Resolved") -> None:
    from vgrd.config.setup import cell_facts
    from vgrd.errors import CalibrationMismatch
    from vgrd.solving.servable import check_usable
    from vgrd.store.calibrations import CalibrationStore

    try:
        stored = CalibrationStore(Path(resolved.config.cell.state_dir)).current()
        check_usable(stored.calibration, cell_facts(resolved.config))
    except CalibrationMismatch as err:
        raise CalibrationMismatch(f"{err}, or reload with --without-calibration") from err
    except (NoCurrentCalibration, StoreError, InputError):
        return  # nothing is served with it now, and a reload makes that no worse


def _wait_until_taken(runtime: Path, loaded_unix_s: float) -> None:
    end_s = time.monotonic() + _TAKEN_S
    while time.monotonic() < end_s:
        report = gate_report(runtime)
        if report is not None and report.asked_unix_s == loaded_unix_s:
            if report.refused:
                raise InputError(report.refused)
            return
        time.sleep(_POLL_S)
    raise DaemonUnreachable(
        f"the daemon in {runtime} has not taken the file over within {_TAKEN_S:.0f} s: see its log"
    )
