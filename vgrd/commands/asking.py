"""How a command finds the running daemon, and asks it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.ipc.control import ControlClient

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
    from rich.console import Console

    with Console(stderr=True).status(op):
        return client.call(op, timeout_s=timeout_s, **given)
