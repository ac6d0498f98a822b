"""Runs the trials of a study: in this process, on several, or on a dask cluster; the results are the same.

Every trial draws from its own child of one seed, and rows come back in their order, so that neither
the number of workers nor who finishes first can change a bit. Clusters of unlike processors may differ
in the last digit, since their numerical libraries do.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from os import getpid

from numpy.random import SeedSequence

from fakes.studies.study import REFUSED, Parameters, Row, Study, Trials
from vgrd.errors import CalibrationError, DeviceUnavailable, InputError
from vgrd.orphans import die_with

_CHUNKS_PER_WORKER = 16  # so that workers end together, whatever the trials take
_LARGEST_CHUNK = 50  # trials: progress is told after each chunk
_CONNECT_TIMEOUT_S = 10  # a scheduler that runs answers in milliseconds
Report = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class _Job:
    """One trial to do."""

    seed: SeedSequence
    case: Parameters
    run: int


def run_trials(
    study: Study,
    runs: int,
    seed: int,
    *,
    workers: int = 1,
    dask: str | None = None,
    report: Report | None = None,
) -> Trials:
    """All trials of a study, `runs` of each case; report(done, total) as they come in.

    More runs repeat the first ones and add to them. Raises InputError for counts below 1 or a
    missing dask, DeviceUnavailable when no dask scheduler answers.
    """
    if runs < 1 or workers < 1:
        raise InputError(f"a study needs at least 1 run and 1 worker, got {runs} and {workers}")
    jobs = _jobs(study, runs, seed)
    size = max(1, min(_LARGEST_CHUNK, len(jobs) // (_CHUNKS_PER_WORKER * workers)))
    chunks = [jobs[i : i + size] for i in range(0, len(jobs), size)]
    rows: list[Row] = []
    with _executor(workers, dask) as executor:
        do = partial(_do, study.trial)
        results = map(do, chunks) if executor is None else executor.map(do, chunks)
        for chunk_rows in results:
            rows += chunk_rows
            if report is not None:
                report(len(rows), len(jobs))
    return Trials(rows)


def _jobs(study: Study, runs: int, seed: int) -> list[_Job]:
    seeds = SeedSequence(seed).spawn(len(study.cases))
    return [
        _Job(child, case, run)
        for case, parent in zip(study.cases, seeds, strict=True)
        for run, child in enumerate(parent.spawn(runs))
    ]


def _do(
    trial: Callable[[SeedSequence, Parameters], Mapping[str, float | str]], jobs: Sequence[_Job]
) -> list[Row]:
    return [_row(trial, job) for job in jobs]


def _row(trial: Callable[[SeedSequence, Parameters], Mapping[str, float | str]], job: _Job) -> Row:
    """Row of one trial; data that are refused count as such, other errors end the study."""
    row: Row = {**job.case, "run": job.run, REFUSED: 0.0}
    try:
        measured = trial(job.seed, job.case)
    except CalibrationError:
        return {**row, REFUSED: 1.0}
    if taken := row.keys() & measured.keys():
        raise ValueError(f"a trial measures {', '.join(sorted(taken))}, which the study names so")
    return {**row, **measured}


@contextmanager
def _executor(workers: int, dask: str | None) -> Iterator[Executor | None]:
    if dask is not None:
        with _dask_executor(dask) as cluster:
            yield cluster
    elif workers == 1:
        yield None
    else:
        context = get_context("spawn")
        with ProcessPoolExecutor(
            workers, context, initializer=die_with, initargs=(getpid(),)
        ) as pool:
            yield pool


@contextmanager
def _dask_executor(address: str) -> Iterator[Executor]:
    try:
        distributed = import_module("distributed")
    except ImportError as err:
        raise InputError(
            "--dask needs the package distributed: pip install 'vgrd[studies]', or use --workers"
        ) from err
    try:
        client = distributed.Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as err:
        raise DeviceUnavailable(
            f"--dask {address}: no scheduler answers there within {_CONNECT_TIMEOUT_S} s: {err}"
        ) from err
    with client, client.get_executor() as executor:
        yield executor
