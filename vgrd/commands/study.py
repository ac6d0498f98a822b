"""The command that repeats the paper's simulations and experiments."""

from pathlib import Path
from typing import Annotated

import typer

from vgrd.printing import JsonOption, Result, console, print_result, progress, table


def register(app: typer.Typer) -> None:
    """Add study."""
    app.command()(study)


def study(
    name: Annotated[
        str,
        typer.Argument(
            help="fig4, fig5, experiment-a, table3, table4, tilt, certificate, coverage, blunders, "
            "coached."
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
