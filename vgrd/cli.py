"""The command line: a person can teach, solve, activate and ask with it.

Commands that talk to a running daemon find it by `--config CELL.toml`, by `--socket PATH`, or by the
environment variables VGRD_CONFIG and VGRD_SOCKET.
"""

import sys
from typing import Annotated

import typer

from vgrd.commands import (
    advise,
    budget,
    daemon,
    detect,
    importing,
    intrinsics,
    recording,
    reloading,
    reporting,
    service,
    solving,
    study,
    target,
)
from vgrd.commands.checking import calibrations, check, drivers, expect, snapshot
from vgrd.commands.wizard import teach
from vgrd.errors import DaemonUnreachable, VgrdError

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (
    advise,
    budget,
    calibrations,
    daemon,
    check,
    drivers,
    expect,
    snapshot,
    detect,
    importing,
    intrinsics,
    recording,
    reloading,
    reporting,
    solving,
    study,
    target,
    teach,
    *service.GROUPS,
):
    group.register(app)


def _tell_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"vgrd {version('vgrd')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Tell the version and end.", callback=_tell_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Calibrate a vision-guided robot cell and serve expected coordinates over Modbus."""


def main() -> None:
    """Entry point: errors of the project become one clear message and their exit code."""
    try:
        app()
    except VgrdError as err:
        from rich.console import Console

        hint = " Start it with: vgrd run CELL.toml" if isinstance(err, DaemonUnreachable) else ""
        Console(stderr=True, soft_wrap=True).print(
            f"vgrd: {err}{hint}", style="bold red", markup=False, highlight=False
        )
        sys.exit(err.exit_code)


if __name__ == "__main__":
    main()
