"""Commands that solve: datasets, recorded sessions, the daemon's session, files of touches."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.asking import SOLVE_TIMEOUT_S, ConfigOption, SocketOption, ask
from vgrd.commands.printing import (
    JsonOption,
    Result,
    console,
    flat,
    print_result,
    progress,
    show_fields,
    table,
)
from vgrd.errors import CalibrationError, InputError

if TYPE_CHECKING:
    from vgrd.geometry import Array

_FIRST = ("good", "limits", "add")  # what is told before anything else
_DRAWN = (
    "budget",
    "map",
    "touches",
    "verification",
)  # figures of a page: vgrd report, vgrd budget


def register(app: typer.Typer) -> None:
    """Add solve and tcp."""
    app.command()(solve)
    app.command()(tcp)


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
    tolerance_mm: Annotated[
        float | None,
        typer.Option(help="Reject what is predicted to miss by more (datasets: at 95 %)."),
    ] = None,
    draw: Annotated[
        Path | None,
        typer.Option(help="Session folders only: folder for pictures of the holes looked for."),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Solve a dataset, a recorded session, or the daemon's last session; nothing becomes active."""
    is_session = source is not None and source.is_dir()
    if method is not None and (source is None or is_session):
        raise InputError("--method is for datasets: name a DATASET.toml")
    if draw is not None and not is_session:
        raise InputError("--draw is for recorded sessions: name a SESSION_FOLDER")
    if tolerance_mm is not None and source is None:
        raise InputError("--tolerance-mm: name a SESSION_FOLDER or a DATASET.toml")
    if tolerance_mm is not None and not 0 < tolerance_mm < math.inf:
        raise InputError(f"--tolerance-mm: {tolerance_mm:g} is no tolerance; give mm above 0")
    if source is None:
        result = ask(config, socket, "solve", SOLVE_TIMEOUT_S)
        _print_calibration(result, json_to, "solved")
    elif source.is_dir():
        from vgrd.solving.session import solve_session

        stability = None if config is None else _stability_in(config)
        with progress("looking for holes") as report:
            result = solve_session(
                source, tolerance_mm=tolerance_mm, stability=stability, report=report, draw=draw
            )
        _print_calibration(result, json_to, f"{source.name} solved")
    else:
        _solve_dataset(source, method, tolerance_mm, json_to)


def _stability_in(config: Path) -> "Array":
    """(6,) of the camera, by the cell file."""
    from vgrd.config.cell_file import load_config
    from vgrd.config.setup import camera_stability

    return camera_stability(load_config(config))


def _print_calibration(result: Result, json_to: str | None, title: str) -> None:
    """Print what was solved; a rejected calibration is told by the exit code too."""

    def show(result: Result) -> None:
        sentences = ("insertions", "blind_spots")
        apart = (*sentences, *_FIRST, "levels", "transforms", *_DRAWN)
        _print_goodness(result)
        show_fields(title)({key: value for key, value in result.items() if key not in apart})
        told = [one for key in sentences for one in result[key]]
        for sentence in (*told, f"verification: {result['verification']['words']}"):
            console.print(sentence, highlight=False, markup=False)

    print_result(result, json_to, show)
    if not result["verdict"]["ok"]:
        raise typer.Exit(CalibrationError.exit_code)


def _print_goodness(result: Result) -> None:
    """Whether it is good, what limits it, then poses and noise in tables."""
    for label, key in zip(("", "limited by ", "to add: "), _FIRST, strict=True):
        if result.get(key):
            console.print(f"{label}{result[key]}", highlight=False, markup=False)
    if poses := result.get("transforms"):
        rows = [
            (name, _place(pose["matrix"]), _three(pose["sigma_mm"]), _three(pose["sigma_deg"]))
            for name, pose in poses.items()
        ]
        console.print(
            table(
                "poses (target_from_source: the source, seen in the target)",
                ("pose", "x y z mm", "sigma mm", "sigma deg"),
                rows,
            )
        )
    if levels := result.get("levels"):
        keys = ("noise", "unit", "stated", "found")
        console.print(table("noise, 1 sigma", keys, [[one[k] for k in keys] for one in levels]))


def _place(matrix: "Array") -> str:
    return " ".join(f"{row[3]:.2f}" for row in matrix[:3])


def _three(sigmas: "Array") -> str:
    return " ".join(f"{sigma:.3f}" for sigma in sigmas)


def _solve_dataset(
    source: Path, method: str | None, tolerance_mm: float | None, json_to: str | None
) -> None:
    from vgrd.solving.datasets import solve_dataset

    with progress("solving") as report:
        solution = solve_dataset(source, report, method=method, tolerance_mm=tolerance_mm)

    def show(result: Result) -> None:
        console.print(solution.sentence, highlight=False, markup=False)
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
        console.print(table("hand-eye", ("what", "value"), solution.summary_rows()))

    print_result(solution.to_json(), json_to, show)
    if solution.ok is False:
        raise typer.Exit(CalibrationError.exit_code)


def tcp(
    source: Annotated[Path, typer.Argument(help="A file of touches (.toml).")],
    tolerance_mm: Annotated[
        float | None,
        typer.Option(min=0, help="Reject a tip that is known to less than that at 95 %."),
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Find the TCP from a file of touches: CAD points, one point, a plane or a ball."""
    from vgrd.solving.touch_files import solve_touches

    def show(result: Result) -> None:
        told_first = next((one for one in solution.verdict.findings if one.fatal), None)
        code = f" ({told_first.code})" if told_first else ""
        console.print(f"{result['summary']}{code}", highlight=False, markup=False)
        for one in solution.verdict.findings:
            if one is not told_first:
                console.print(f"{one.code}: {one.message}", highlight=False, markup=False)
        for what in ("touches", "levels"):
            rows = result[what]
            keys = tuple(rows[0])
            cells = [[row[key] for key in keys] for row in rows]
            console.print(table(f"{source}: {what}", keys, cells))
        told = ("summary", "touches", "levels", "verdict")
        rest = {key: value for key, value in result.items() if key not in told}
        console.print(table("TCP in the wrist", ("what", "value"), list(flat(rest))))

    solution = solve_touches(source, tolerance_mm=tolerance_mm)
    print_result(solution.to_json(), json_to, show)
    if not solution.verdict.ok:
        raise typer.Exit(CalibrationError.exit_code)
