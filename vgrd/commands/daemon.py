"""Commands that run the daemon and use what it serves."""

import os
import sys
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vgrd.commands.asking import ConfigOption, SocketOption, ask, client_of
from vgrd.commands.printing import JsonOption, print_result, show_fields
from vgrd.commands.reloading import file_now, running_file
from vgrd.errors import ConfigError, InputError

if TYPE_CHECKING:  # pydantic is slow to load, and most commands do without
    from vgrd.config.cell_file import CellSection
    from vgrd.geometry import Array, Pose

_OF_UNIT = {"runtime_dir": "RUNTIME_DIRECTORY", "state_dir": "STATE_DIRECTORY"}


def register(app: typer.Typer) -> None:
    """Add run, status, activate, rollback, ec and confirm."""
    for command in (run, status, activate, rollback, ec, confirm):
        app.command()(command)


def run(config: Annotated[Path, typer.Argument(help="The cell file.")]) -> None:
    """Run the daemon in the foreground until Ctrl-C or SIGTERM."""
    from vgrd.config.cell_file import load_config
    from vgrd.config.resolved import Resolved, forget_resolved, save_resolved
    from vgrd.config.setup import STATE_PARTS, process_table
    from vgrd.gate.gate import lock
    from vgrd.gate.settings import WANTED_TABLE, save_table

    loaded = load_config(config)
    runtime = _runtime_folder(loaded.cell)
    _own_folder("state_dir", loaded.cell, STATE_PARTS)
    lock(runtime)  # released by exec, and taken again by the gate
    resolved = Resolved(loaded, str(config.resolve()), time.time())
    path = save_resolved(resolved, runtime)
    save_table(runtime, process_table(resolved, path))
    (runtime / WANTED_TABLE).unlink(missing_ok=True)
    forget_resolved(runtime, but=path)
    os.execv(sys.executable, [sys.executable, "-m", "vgrd.gate", str(runtime)])  # noqa: S606


def _runtime_folder(cell: "CellSection") -> Path:
    from vgrd.config.setup import RUNTIME_PARTS, SOCKET_FOLDER_BYTES

    path = cell.runtime_dir
    if len(os.fsencode(path)) > SOCKET_FOLDER_BYTES:
        raise InputError(
            f"runtime folder {path}: too long for a Unix socket in it (more than "
            f"{SOCKET_FOLDER_BYTES} bytes); set [cell] runtime_dir to a shorter path"
        )
    return _own_folder("runtime_dir", cell, RUNTIME_PARTS)


def _own_folder(key: str, cell: "CellSection", parts: tuple[str, ...]) -> Path:
    """Make the folder, or close an old one to all but the user and the group."""
    from vgrd.permissions import group_let_in, own_folder

    path = getattr(cell, key)
    is_units = path == os.environ.get(_OF_UNIT[key])
    try:
        group = cell.group or (group_let_in(Path(path)) if is_units else None)
        open_to_others = own_folder(Path(path), group, parts)
    except OSError as err:
        raise InputError(
            f"{key.replace('_dir', '')} folder {path}: {err.strerror}; "
            f"set [cell] {key} to a folder of yours"
        ) from err
    for left in open_to_others:
        typer.echo(f"vgrd: {left}: open to other users, not ours to close: chown it", err=True)
    return Path(path)


def status(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """Show how the cell is, and whether its file on the disk is what it works with."""
    result = ask(config, socket, "status")
    runtime = client_of(config, socket).path.parent
    loaded = datetime.fromtimestamp(float(str(result["cell_file_loaded_unix_s"])), tz=UTC)
    result["cell_file_loaded"] = loaded.astimezone().isoformat(sep=" ", timespec="seconds")
    try:
        result["cell_file_now"] = file_now(running_file(runtime))
    except ConfigError as err:
        result["cell_file_now"] = f"not known: {'; '.join(err.faults)}"
    print_result(result, json_to, show_fields("status"))


def activate(
    calibration: Annotated[str, typer.Argument(help="Calibration id, such as cal-000001.")],
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Serve with this calibration from now on (logged, reversible)."""
    result = ask(config, socket, "activate", calibration=calibration)
    print_result(result, json_to, show_fields("active"))


def rollback(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """Serve again with the calibration that was active before this one (logged, reversible)."""
    print_result(ask(config, socket, "rollback"), json_to, show_fields("active"))


def ec(
    target: Annotated[str, typer.Argument(help="Name of the target.")],
    policy: Annotated[
        str | None, typer.Option(help="fixed, follow or requested; as configured if left out.")
    ] = None,
    work_rotvec_deg: Annotated[
        str | None,
        typer.Option(help="Orientation of the wrist at the touch, such as '180 0 0'."),
    ] = None,
    brand: Annotated[
        str | None,
        typer.Option(
            "--for",
            help="Also as this brand writes it: ur, kuka, fanuc, abb, ... (docs/poses.md).",
        ),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Compute an expected coordinate from a fresh picture: where the flange must be, in the robot's base."""
    if brand is not None:
        from vgrd.geometry.brands import brand_form

        form = brand_form(brand)  # a wrong name is told at once
    result = ask(
        config, socket, "ec", target=target, policy=policy, work_rotvec_deg=work_rotvec_deg
    )
    if brand is not None:
        result[f"for_{brand.lower()}"] = form.write(*_pose_told(result))
    print_result(result, json_to, show_fields(f"expected coordinate of {target}"))


def _pose_told(result: Mapping[str, Any]) -> tuple["Pose", "Array"]:
    """The pose of a result of `ec`, and its rotation vector, (3,) rad, as it was written."""
    import numpy as np

    from vgrd.geometry import Pose

    rotvec = np.radians(result["rotvec_deg"])
    return Pose.from_rotvec(rotvec, result["position_mm"]), rotvec


def confirm(
    accept: Annotated[
        str | None,
        typer.Option(
            help="Take over that 'tag A' or 'tag B' slipped a little; verify it by a touch."
        ),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Confirm that the cause of a latched fault is gone."""
    result = ask(config, socket, "confirm", accept=accept)
    print_result(result, json_to, show_fields("confirm"))
