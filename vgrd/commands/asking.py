"""How a command finds the running daemon, and asks it."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.printing import waiting
from vgrd.errors import DaemonSilent, DaemonUnreachable, InputError, IpcError

if TYPE_CHECKING:
    from vgrd.ipc.control import ControlClient
    from vgrd.ipc.messages import GateReport

_FRESH_S = 2.0  # the gate reports four times a second
SAMPLE_TIMEOUT_S = 15.0  # a sample's two pictures, 5 s each, and 5 s of room
SOLVE_TIMEOUT_S = 300.0  # a guess; the daemon gives up at 280 s, so that its reason arrives

_INSTALLED = Path("/etc/vgrd/cell.toml")  # where `vgrd install` puts it; sudo forgets VGRD_CONFIG


def _or_installed(named: Path | None) -> Path | None:
    """The cell file that was named, else that of the service on this machine, if there is one."""
    return named or (_INSTALLED if _INSTALLED.exists() else None)


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        envvar="VGRD_CONFIG",
        callback=_or_installed,
        readable=False,  # not typer's to refuse: who reads it tells who may, and the way in
        help="The cell file of the daemon; that of the service if left out.",
    ),
]
SocketOption = Annotated[
    Path | None,
    typer.Option("--socket", envvar="VGRD_SOCKET", help="The daemon's control socket."),
]


def client_of(config: Path | None, socket: Path | None) -> "ControlClient":
    """The daemon that --config or --socket names; raises InputError when neither is given."""
    from vgrd.ipc.control import ControlClient

    if socket is not None:
        return ControlClient(socket)
    if config is None:
        raise InputError("which daemon? Give --config CELL.toml or --socket PATH")
    from vgrd.config.cell_file import load_config
    from vgrd.config.setup import CONTROL_SOCKET

    return ControlClient(Path(load_config(config).cell.runtime_dir) / CONTROL_SOCKET)


def ask(
    config: Path | None,
    socket: Path | None,
    op: str,
    timeout_s: float = SAMPLE_TIMEOUT_S,
    /,
    **arguments: str | bool | None,
) -> dict[str, object]:
    """Call one operation of the daemon; arguments that are None are left to its configuration."""
    given: dict[str, object] = {k: v for k, v in arguments.items() if v is not None}
    client = client_of(config, socket)
    with waiting(op):
        try:
            return client.call(op, timeout_s=timeout_s, **given)
        except DaemonUnreachable as err:
            if (report := gate_report(client.path.parent)) is None:
                raise
            raise DaemonSilent(_silence(client.path.parent, report)) from err


def _silence(runtime: Path, report: "GateReport") -> str:
    """Why a daemon that runs does not answer."""
    from vgrd.gate.settings import CELL_KIND, PROCESS_TABLE, load_settings

    since_s = time.time() - load_settings(runtime / PROCESS_TABLE).loaded_unix_s
    cell = next((row for row in report.processes if row.kind == CELL_KIND), None)
    if cell is None or (cell.starts <= 1 and cell.state == "running"):
        return f"the daemon (process {report.pid}) is starting since {since_s:.0f} s: ask again"
    return (
        f"the daemon (process {report.pid}) runs, but its cell does not answer: {cell.state}, started "
        f"{cell.starts} times, {cell.health} {cell.detail}".rstrip()
    )


def gate_report(runtime: Path) -> "GateReport | None":
    """The last word of a gate that is alive, None without one."""
    from vgrd.ipc.messages import GATE_KIND, GATE_RING, GateReport
    from vgrd.ipc.ring import RingReader

    try:
        with RingReader.open(runtime / GATE_RING, GATE_KIND) as ring:
            message = ring.newest()
    except IpcError:
        return None
    if message is None or time.monotonic() - message.stamp_s > _FRESH_S:
        return None
    return GateReport.unpack(message.payload)
