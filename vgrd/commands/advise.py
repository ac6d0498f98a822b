"""The command that tells what a session still needs."""

from pathlib import Path
from typing import Annotated

import typer

from vgrd.commands.asking import ConfigOption, SocketOption, ask
from vgrd.commands.printing import JsonOption, print_result, show_fields

_REPLY_S = 10.0  # beyond the wait: the daemon's own time on a busy machine


def register(app: typer.Typer) -> None:
    """Add advise."""
    app.command()(advise)


def advise(
    session: Annotated[
        Path | None, typer.Argument(help="A session folder; none: the daemon's session.")
    ] = None,
    policy: Annotated[
        str | None, typer.Option(help="fixed, follow or requested; as configured if left out.")
    ] = None,
    tilt_deg: Annotated[
        float | None, typer.Option(help="How far the tool may tilt; 0 for four axes.")
    ] = None,
    yaw_deg: Annotated[
        float | None, typer.Option(help="How far the wrist may turn about the tool, either way.")
    ] = None,
    wait: Annotated[
        float,
        typer.Option(
            min=0, max=60, help="Seconds to wait for the daemon's computing; it goes on meanwhile."
        ),
    ] = 2.0,  # as WAIT_S of the advisor
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Tell what was found so far, the error to expect, and the best next sample."""
    if session is None:
        result = ask(
            config,
            socket,
            "advise",
            wait + _REPLY_S,
            wait_s=str(wait),
            policy=policy,
            tilt_deg=None if tilt_deg is None else str(tilt_deg),
            yaw_deg=None if yaw_deg is None else str(yaw_deg),
        )
    else:
        from vgrd.solving.advisor import advise_folder, policy_called

        result = advise_folder(session, policy_called(policy or "fixed"), tilt_deg, yaw_deg)
    print_result(result, json_to, show_fields("advice"))
