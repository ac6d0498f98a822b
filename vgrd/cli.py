"""The command line: a person can teach, solve, activate and ask with it.

Commands that talk to a running daemon find it by `--config CELL.toml`, by `--socket PATH`, or by the
environment variables VGRD_CONFIG and VGRD_SOCKET.
"""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from vgrd.errors import CalibrationError, DaemonUnreachable, InputError, VgrdError
from vgrd.ipc.control import ControlClient
from vgrd.printing import (
    JsonOption,
    Result,
    console,
    flat,
    print_result,
    progress,
    show_fields,
    table,
)

SAMPLE_TIMEOUT_S = 15.0
SOLVE_TIMEOUT_S = 300.0
SOCKET_FOLDER_BYTES = 90

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Calibrate a vision-guided robot cell and serve expected coordinates over Modbus.",
)
record_app = typer.Typer(no_args_is_help=True, help="Start and stop recording a teaching session.")
app.add_typer(record_app, name="record")

ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", envvar="VGRD_CONFIG", help="The cell file of the daemon."),
]
SocketOption = Annotated[
    Path | None,
    typer.Option("--socket", envvar="VGRD_SOCKET", help="The daemon's control socket."),
]


def _client(config: Path | None, socket: Path | None) -> ControlClient:
    if socket is not None:
        return ControlClient(socket)
    if config is None:
        raise InputError("which daemon? Give --config CELL.toml or --socket PATH")
    from vgrd.cell.setup import CONTROL_SOCKET
    from vgrd.config import load_config

    return ControlClient(Path(load_config(config).cell.runtime_dir) / CONTROL_SOCKET)


def _ask(
    config: Path | None,
    socket: Path | None,
    op: str,
    *,
    timeout_s: float = SAMPLE_TIMEOUT_S,
    **arguments: str | None,
) -> dict[str, object]:
    given: dict[str, object] = {k: v for k, v in arguments.items() if v is not None}
    client = _client(config, socket)
    with Console(stderr=True).status(op):
        return client.call(op, timeout_s=timeout_s, **given)


@app.command()
def run(config: Annotated[Path, typer.Argument(help="The cell file.")]) -> None:
    """Run the daemon in the foreground until Ctrl-C or SIGTERM."""
    from vgrd.cell.setup import process_table
    from vgrd.config import load_config
    from vgrd.gate.gate import lock
    from vgrd.gate.settings import save_table

    loaded = load_config(config)
    runtime = _runtime_folder(Path(loaded.cell.runtime_dir))
    lock(runtime)  # released by exec, and taken again by the gate
    save_table(runtime, process_table(loaded, config))
    os.execv(sys.executable, [sys.executable, "-m", "vgrd.gate", str(runtime)])  # noqa: S606


def _runtime_folder(path: Path) -> Path:
    if len(bytes(path)) > SOCKET_FOLDER_BYTES:
        raise InputError(
            f"runtime folder {path}: too long for a Unix socket in it (more than "
            f"{SOCKET_FOLDER_BYTES} bytes); set [cell] runtime_dir to a shorter path"
        )
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise InputError(
            f"runtime folder {path}: {err.strerror}; set [cell] runtime_dir to a folder of yours"
        ) from err
    return path


@app.command()
def check(
    config: Annotated[Path, typer.Argument(help="The cell file.")], json_to: JsonOption = None
) -> None:
    """Check a cell file; every fault is reported at once."""
    from vgrd.config import load_config

    loaded = load_config(config)
    result = {
        "ok": True,
        "cell": loaded.cell.name,
        "robot": loaded.robot.driver,
        "camera": loaded.camera.driver,
        "targets": [target.name for target in loaded.object.targets],
        "registers": f"{loaded.serving.host}:{loaded.serving.port}",
        "state_dir": loaded.cell.state_dir,
        "runtime_dir": loaded.cell.runtime_dir,
    }
    print_result(result, json_to, show_fields(f"{config} is good"))


@app.command()
def status(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """Show how the cell is."""
    print_result(_ask(config, socket, "status"), json_to, show_fields("status"))


@record_app.command("start")
def record_start(
    plan: Annotated[
        str, typer.Option(help="universal, special, conventional or joint.")
    ] = "joint",
    session: Annotated[
        str | None, typer.Option(help="Name; by default the date and time.")
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Start recording a session."""
    result = _ask(config, socket, "record.start", plan=plan, session=session)
    print_result(result, json_to, show_fields("recording"))


@record_app.command("stop")
def record_stop(
    config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
) -> None:
    """End the session and close its files."""
    print_result(_ask(config, socket, "record.stop"), json_to, show_fields("recorded"))


def _sample_command(op: str, argument: str | None, text: str) -> None:
    """Register one teaching command; they differ in name and argument only."""
    if argument is None:

        def plain(
            config: ConfigOption = None, socket: SocketOption = None, json_to: JsonOption = None
        ) -> None:
            print_result(_ask(config, socket, op), json_to, show_fields(op))

        app.command(op, help=text)(plain)
        return

    def named(
        name: Annotated[str, typer.Argument(metavar=argument)],
        config: ConfigOption = None,
        socket: SocketOption = None,
        json_to: JsonOption = None,
    ) -> None:
        client = _client(config, socket)
        arguments: dict[str, object] = {argument.lower(): name}
        with Console(stderr=True).status(op):
            result = client.call(op, timeout_s=SAMPLE_TIMEOUT_S, **arguments)
        print_result(result, json_to, show_fields(op))

    app.command(op, help=text)(named)


_sample_command("look", None, "Record a hand-eye sample: robot at rest, tag A in view.")
_sample_command("spin", None, "Record the turned object: robot at rest, tag B in view.")
_sample_command("touch", "TARGET", "Record that the tool's tip rests on a target.")
_sample_command("point", "NAME", "Record a touch of a fixed point (conventional TCP).")
_sample_command("verify", "TARGET", "Record a touch that is held out of every fit.")
_sample_command("undo", None, "Take back the last sample.")
_sample_command("confirm", None, "Confirm that the cause of a latched fault is gone.")


@app.command()
def solve(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="A dataset file (.toml) or a session folder; none: the daemon's session."
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="Datasets only: a published method, unrefined, such as tsai-lenz."),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Solve a dataset, a recorded session, or the daemon's last session; nothing becomes active."""
    if method is not None and (source is None or source.is_dir()):
        raise InputError("--method is for datasets: name a DATASET.toml")
    if source is None:
        result = _ask(config, socket, "solve", timeout_s=SOLVE_TIMEOUT_S)
        _print_calibration(result, json_to, "solved")
    elif source.is_dir():
        from vgrd.cell.solver import solve_session

        _print_calibration(solve_session(source), json_to, f"{source.name} solved")
    else:
        _solve_dataset(source, method, json_to)


def _print_calibration(result: Result, json_to: str | None, title: str) -> None:
    """Print what was solved; a rejected calibration is told by the exit code too."""
    print_result(result, json_to, show_fields(title))
    if not result["verdict"]["ok"]:
        raise typer.Exit(CalibrationError.exit_code)


def _solve_dataset(source: Path, method: str | None, json_to: str | None) -> None:
    from vgrd.datasets import solve_dataset

    with progress("solving") as report:
        solution = solve_dataset(source, report, method=method)

    def show(result: Result) -> None:
        console.print(
            table(
                f"{source}: samples",
                ("sample", "used", "px", "deg", "mm", "reason"),
                [
                    [s[k] for k in ("name", "used", "px", "deg", "mm", "reason")]
                    for s in result["samples"]
                ],
            )
        )
        rows = [(key, result[key]) for key in ("leave_one_out", "target_scale", "verdict")]
        console.print(table("hand-eye", ("what", "value"), list(flat(dict(rows)))))

    print_result(solution.to_json(), json_to, show)


@app.command()
def tcp(
    source: Annotated[Path, typer.Argument(help="A file of touches (.toml).")],
    json_to: JsonOption = None,
) -> None:
    """Find the TCP from a file of touches: CAD points, one point, a plane or a ball."""
    from vgrd.touch_files import solve_touches

    def show(result: Result) -> None:
        keys = ("name", "used", "residual_mm", "reason")
        rows = [[touch[key] for key in keys] for touch in result["touches"]]
        console.print(table(f"{source}: touches", keys, rows))
        rest = {key: value for key, value in result.items() if key != "touches"}
        console.print(table("TCP in the wrist", ("what", "value"), list(flat(rest))))

    solution = solve_touches(source)
    print_result(solution.to_json(), json_to, show)
    if not solution.verdict.ok:
        raise typer.Exit(CalibrationError.exit_code)


@app.command()
def activate(
    calibration: Annotated[str, typer.Argument(help="Calibration id, such as cal-000001.")],
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Serve with this calibration from now on (logged, reversible)."""
    result = _ask(config, socket, "activate", calibration=calibration)
    print_result(result, json_to, show_fields("active"))


@app.command()
def ec(
    target: Annotated[str, typer.Argument(help="Name of the target.")],
    policy: Annotated[
        str | None, typer.Option(help="fixed or follow; as configured if left out.")
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Compute an expected coordinate from a fresh picture."""
    result = _ask(config, socket, "ec", target=target, policy=policy)
    print_result(result, json_to, show_fields(f"expected coordinate of {target}"))


@app.command()
def study(
    name: Annotated[
        str,
        typer.Argument(
            help="fig4, fig5, experiment-a, table3, table4, tilt, certificate, coverage, blunders."
        ),
    ],
    runs: Annotated[int | None, typer.Option(min=1, help="Trials of each case.")] = None,
    full: Annotated[bool, typer.Option("--full", help="As many trials as it ever needs.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other trials.")] = 20,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    dask: Annotated[str | None, typer.Option(help="Address of a dask scheduler.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for NAME.csv and NAME.png.")] = Path(
        "build/studies"
    ),
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw NAME.png.")] = True,
    json_to: JsonOption = None,
) -> None:
    """Repeat a simulation or experiment of the paper; exit code 1 when a figure misses its bar."""
    from vgrd.studies.conducting import conduct

    with progress(name) as report:
        outcome = conduct(
            name,
            runs=runs,
            full=full,
            seed=seed,
            workers=workers,
            dask=dask,
            out=out,
            plot=plot,
            report=report,
        )
    print_result(outcome.to_json(), json_to, _show_study)
    if not outcome.ok:
        raise typer.Exit(1)


def _show_study(result: Result) -> None:
    verdicts = {True: "ok", False: "MISSED", None: ""}
    rows = [
        (f["name"], _short(f["value"]), f["unit"], f["bar"], verdicts[f["ok"]], f["paper"])
        for f in result["figures"]
    ]
    title = f"{result['title']} ({result['runs']} runs each)"
    console.print(table(title, ("figure", "value", "unit", "bar", "", "paper"), rows))
    console.print(f"wrote {', '.join(result['files'])}", highlight=False)


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def main() -> None:
    """Entry point: errors of the project become one clear message and their exit code."""
    try:
        app()
    except VgrdError as err:
        hint = " Start it with: vgrd run CELL.toml" if isinstance(err, DaemonUnreachable) else ""
        Console(stderr=True, soft_wrap=True).print(
            f"vgrd: {err}{hint}", style="bold red", markup=False, highlight=False
        )
        sys.exit(err.exit_code)


if __name__ == "__main__":
    main()
