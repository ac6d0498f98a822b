"""Commands that teach: a session's start and end, and its samples."""

from typing import Annotated

import typer

from vgrd.commands.asking import SAMPLE_TIMEOUT_S, ConfigOption, SocketOption, ask
from vgrd.commands.printing import JsonOption, print_result, show_fields

_PLAIN = {
    "look": "Record a hand-eye sample: robot at rest, tag A in view.",
    "spin": "Record the turned object: robot at rest, tag B in view.",
}
_NAMED = {
    "touch": ("TARGET", "Record that the tool's tip rests on a target."),
    "point": ("NAME", "Record a touch of the fixed point, plane or ball that gives the TCP."),
    "verify": (
        "TARGET",
        "Record a touch that is held out of every fit; without a session, judge the calibration in use.",
    ),
}


def register(app: typer.Typer) -> None:
    """Add record start, record stop, and one command per kind of sample."""
    record = typer.Typer(no_args_is_help=True, help="Start and stop recording a teaching session.")
    record.command("start")(record_start)
    record.command("stop")(record_stop)
    record.command("samples")(record_samples)
    app.add_typer(record, name="record")
    app.command("undo")(undo)
    app.command("retag")(retag)
    for op, text in _PLAIN.items():
        _plain(app, op, text)
    for op, (argument, text) in _NAMED.items():
        _named(app, op, argument, text)


def record_start(
    plan: Annotated[
        str, typer.Option(help="joint, universal, special, conventional, plane or sphere.")
    ] = "joint",
    session: Annotated[
        str | None, typer.Option(help="Name; by default the date and time.")
    ] = None,
    harvest: Annotated[
        bool, typer.Option(help="Plan joint: rests become looks and spins unasked.")
    ] = True,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Start recording a session."""
    result = ask(config, socket, "record.start", plan=plan, session=session, harvest=harvest)
    print_result(result, json_to, show_fields("recording"))


def record_stop(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """End the session and close its files."""
    print_result(ask(config, socket, "record.stop"), json_to, show_fields("recorded"))


def record_samples(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """List the samples of the session being recorded by their numbers."""
    print_result(ask(config, socket, "record.samples"), json_to, show_fields("samples"))


def undo(
    sample: Annotated[
        str | None,
        typer.Argument(
            metavar="SAMPLE",
            help="Number of a sample, as its reply told; or the last look, spin, touch, point, verify or "
            "harvested one. By default the last that was asked for.",
        ),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Take back a sample: it stays in the file, marked, and counts no more.

    Without a session it is the last verification of the calibration in use.
    """
    is_number = sample is not None and sample.isdecimal()
    name = "sample" if is_number else "kind"
    print_result(ask(config, socket, "undo", **{name: sample}), json_to, show_fields("undo"))


def retag(
    sample: Annotated[int, typer.Argument(help="Number of the touch, as its reply told.")],
    target: Annotated[str, typer.Argument(help="The target that was touched.")],
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Book a touch under another target: the tip was right, its name was not."""
    result = ask(config, socket, "retag", sample=str(sample), target=target)
    print_result(result, json_to, show_fields("retag"))


def _plain(app: typer.Typer, op: str, text: str) -> None:
    def plain(
        config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
    ) -> None:
        print_result(ask(config, socket, op), json_to, show_fields(op))

    app.command(op, help=text)(plain)


def _named(app: typer.Typer, op: str, argument: str, text: str) -> None:
    def named(
        name: Annotated[str, typer.Argument(metavar=argument)],
        config: ConfigOption = None,
        socket: SocketOption = None,
        json_to: JsonOption = None,
    ) -> None:
        print_result(
            ask(config, socket, op, SAMPLE_TIMEOUT_S, **{argument.lower(): name}),
            json_to,
            show_fields(op),
        )

    app.command(op, help=text)(named)
