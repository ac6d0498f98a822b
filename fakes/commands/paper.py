"""The paper beside vgrd, on one page: every study that shows something of it is run anew."""

from pathlib import Path
from typing import Annotated

import typer

from fakes.studies.conducting import SEED, StudyOutcome, conduct
from fakes.studies.page import CHAPTERS, page
from vgrd.commands.printing import console, progress
from vgrd.errors import InputError

_INDEX = Path(__file__).parents[2] / "docs" / "paper.md"


def main(
    out: Annotated[Path, typer.Option(help="The page, one file.")] = Path("build/paper.html"),
    share: Annotated[
        float, typer.Option(min=0.0, max=100.0, help="Of the usual number of trials.")
    ] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other trials.")] = SEED,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 2,
) -> None:
    """Run the paper's simulations and experiments, and write them down beside the paper's data."""
    folder = out.parent / "paper"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        out.touch()
    except OSError as err:
        raise InputError(f"--out {out}: {err.strerror}; name a file of yours") from err
    outcomes: dict[str, StudyOutcome] = {}
    for chapter in (chapter for _, chapters in CHAPTERS for chapter in chapters):
        runs = max(1, round(share * chapter.runs))
        with progress(chapter.study) as report:
            outcomes[chapter.study] = conduct(
                chapter.study, runs=runs, seed=seed, workers=workers, folder=folder, report=report
            )
        console.print(f"{chapter.heading}: {_verdict(outcomes[chapter.study])}", highlight=False)
    index = _INDEX.read_text(encoding="utf-8") if _INDEX.exists() else "docs/paper.md is not here."
    out.write_text(page(outcomes, index), encoding="utf-8")
    console.print(f"wrote {out}", highlight=False)


def _verdict(outcome: StudyOutcome) -> str:
    missed = [figure.name for figure in outcome.figures if figure.ok is False]
    return "every bar is met" if not missed else f"{len(missed)} bars missed: {'; '.join(missed)}"
