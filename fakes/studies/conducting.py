"""A study from its name to its files: NAME.csv with every trial and NAME.png in a folder."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fakes.studies.catalogue import study_called
from fakes.studies.runner import Report, run_trials
from fakes.studies.study import REFUSED, Figure, Trials
from vgrd.charts import check_matplotlib
from vgrd.errors import InputError

SEED = 20  # any one: docs/studies.md was made with it


@dataclass(frozen=True, slots=True)
class StudyOutcome:
    """What a study found, and the files it wrote."""

    name: str
    title: str
    runs: int
    seed: int
    figures: tuple[Figure, ...]
    files: tuple[Path, ...]

    @property
    def ok(self) -> bool:
        """True when no bar was missed."""
        return all(figure.ok is not False for figure in self.figures)

    def to_json(self) -> dict[str, object]:
        """The JSON file: every figure with its bar."""
        return {
            "study": self.name,
            "title": self.title,
            "runs": self.runs,
            "seed": self.seed,
            "ok": self.ok,
            "figures": [figure.as_json() for figure in self.figures],
            "files": [str(path) for path in self.files],
        }


def conduct(
    name: str,
    *,
    runs: int | None = None,
    full: bool = False,
    seed: int = SEED,
    workers: int = 1,
    dask: str | None = None,
    folder: Path,
    plot: bool = True,
    report: Report | None = None,
) -> StudyOutcome:
    """Run a study and write its files into `folder`, which is made.

    runs: of each case, None takes the study's own number (its full one with `full`). Raises
    InputError for an unknown name, a folder that cannot be used, or a missing package.
    """
    study = study_called(name)
    if plot:
        check_matplotlib()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise InputError(f"--out {folder}: {err.strerror}; name a folder of yours") from err
    count = runs or ((study.full_runs or study.runs) if full else study.runs)
    trials = run_trials(study, count, seed, workers=workers, dask=dask, report=report)
    files = [folder / f"{name}.csv"]
    _write_csv(files[0], trials)
    if plot:
        files.append(folder / f"{name}.png")
        study.draw(trials).savefig(files[1])
    figures = (*study.figures(trials), _refused(trials, study.most_refused))
    return StudyOutcome(name, study.title, count, seed, figures, tuple(files))


def _refused(trials: Trials, most: float) -> Figure:
    """Trials whose data a method refused measured nothing: many of them would flatter what is left."""
    refused = 100 * float(np.mean([row[REFUSED] for row in trials.rows]))
    return Figure("trials refused", refused, "%", at_most=100 * most)


def _write_csv(path: Path, trials: Trials) -> None:
    columns = dict.fromkeys(key for row in trials.rows for key in row)
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(columns), lineterminator="\n")
            writer.writeheader()
            writer.writerows(trials.rows)
    except OSError as err:
        raise InputError(f"{path}: cannot be written: {err.strerror}") from err
