"""`python -m fakes.studies NAME`: the command line behind `vgrd study`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from fakes.studies.catalogue import STUDIES
from fakes.studies.conducting import SEED, conduct
from vgrd.commands.printing import JsonOption, Result, console, print_result, progress, table

_NAMES = "\n\n".join(f"{name}: {study.title}" for name, study in STUDIES.items())
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command(
    help="Repeat a simulation or experiment of the paper, or one of ours; exit code 1 when a figure "
    f"misses its bar.\n\nStudies:\n\n{_NAMES}"
)
def study(
    name: Annotated[str, typer.Argument(help="One of the studies named above.")],
    runs: Annotated[int | None, typer.Option(min=1, help="Trials of each case.")] = None,
    full: Annotated[bool, typer.Option("--full", help="As many trials as it ever needs.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other trials.")] = SEED,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    dask: Annotated[str | None, typer.Option(help="Address of a dask scheduler.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for NAME.csv and NAME.png.")] = Path(
        "build/studies"
    ),
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw NAME.png.")] = True,
    json_to: JsonOption = None,
) -> None:
    """Run it and print its figures."""
    with progress(name) as report:
        outcome = conduct(
            name,
            runs=runs,
            full=full,
            seed=seed,
            workers=workers,
            dask=dask,
            folder=out,
            plot=plot,
            report=report,
        )
    print_result(outcome.to_json(), json_to, _show_study)
    if not outcome.ok:
        raise typer.Exit(1)


def _show_study(result: Result) -> None:
    verdicts = {True: "ok", False: "MISSED", None: ""}
    columns = ["figure", "value", "unit", "bar", "", "paper"]
    rows = [
        [f["name"], _short(f["value"]), f["unit"], f["bar"], verdicts[f["ok"]], f["paper"]]
        for f in result["figures"]
    ]
    if any(f["interval"] for f in result["figures"]):
        columns.append("95 % of its sample")
        for row, f in zip(rows, result["figures"], strict=True):
            row.append(_sample(f["interval"], f["paper_inside"]))
    title = f"{result['title']} ({result['runs']} runs each)"
    console.print(table(title, columns, rows))
    console.print(f"wrote {', '.join(result['files'])}", highlight=False)


def _sample(interval: list[float] | None, paper_inside: bool | None) -> str:
    """What as few repetitions as the paper's leave open, and whether the paper's figure lies in it."""
    if interval is None:
        return ""
    return f"{interval[0]:.3g} .. {interval[1]:.3g}: {'in' if paper_inside else 'out'}"


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


if __name__ == "__main__":
    app(args=sys.argv[1:], prog_name="vgrd study")
