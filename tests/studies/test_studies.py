import csv
import json
import os
import select
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.catalogue import STUDIES, study_called
from fakes.studies.conducting import conduct
from fakes.studies.runner import run_trials
from fakes.studies.study import Figure, Study, Trials
from vgrd.charts import panels
from vgrd.errors import DeviceUnavailable, InputError, NotObservable
from vgrd.orphans import dying_with_us

PNG = b"\x89PNG\r\n\x1a\n"


def value(outcome, name):
    (figure,) = [f for f in outcome.figures if f.name == name]
    return figure.value


def drawing_number(seed, parameters):
    """A trial that refuses every third number."""
    number = float(np.random.default_rng(seed).uniform())
    if number < parameters["refuse_below"]:
        raise NotObservable("too small", rank=0, unknowns=1)
    return {"number": number}


NUMBERS = Study(
    name="numbers",
    title="Numbers",
    cases=({"refuse_below": 0.0}, {"refuse_below": 0.5}),
    runs=3,
    trial=drawing_number,
    figures=lambda trials: [Figure("mean", trials.mean("number"))],
    draw=lambda trials: panels(f"{len(trials.rows)}", ("x", "y"))[0],
)


@pytest.mark.exact("workers are processes of their own, which --perturb does not reach")
@pytest.mark.parametrize("name", ["fig4", "blunders"])
def test_results_are_bit_identical_for_one_and_two_workers(name, tmp_path):
    runs = {"fig4": 40, "blunders": 1}[name]
    files = []
    for workers in (1, 2):
        outcome = conduct(
            name, runs=runs, workers=workers, folder=tmp_path / f"{workers}", plot=False
        )
        files.append(outcome.files[0].read_bytes())
    assert files[0] == files[1]


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_no_worker_outlives_a_study_that_is_killed(how):
    argv = [sys.executable, str(Path(__file__).with_name("endless_study.py"))]
    with subprocess.Popen(dying_with_us(argv), stdout=subprocess.PIPE, text=True) as study:
        workers = [os.pidfd_open(int(study.stdout.readline())) for _ in range(2)]
        study.send_signal(how)
    for worker in workers:
        assert select.select([worker], [], [], 10.0)[0], "it is still there after 10 s"
        os.close(worker)


def test_a_dask_cluster_gives_the_same_rows_as_this_process():
    distributed = pytest.importorskip("distributed")
    here = run_trials(STUDIES["fig4"], 12, 3)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        there = run_trials(STUDIES["fig4"], 12, 3, dask=cluster.scheduler_address)
    assert there.rows == here.rows


def test_a_scheduler_that_is_not_there_and_a_missing_package_are_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'vgrd\[studies\]'"):
        run_trials(NUMBERS, 1, 0, dask="tcp://127.0.0.1:1")


def test_an_address_that_is_none_is_refused():
    pytest.importorskip("distributed")
    with pytest.raises(DeviceUnavailable, match="no scheduler answers"):
        run_trials(NUMBERS, 1, 0, dask="nonsense")


def test_more_runs_repeat_the_first_ones_and_another_seed_does_not():
    few, many = (run_trials(NUMBERS, runs, 7).rows for runs in (2, 5))
    assert [row for row in many if row["run"] < 2] == list(few)
    assert run_trials(NUMBERS, 2, 8).rows != few


def test_refused_trials_are_counted_and_measure_nothing():
    trials = run_trials(NUMBERS, 60, 1)
    refused = [row for row in trials.rows if row["refused"]]
    assert 15 <= len(refused) <= 45
    assert all("number" not in row and row["refuse_below"] == 0.5 for row in refused)
    assert len(trials.values("number", refuse_below=0.5)) == 60 - len(refused)
    assert trials.values("number", refuse_below=0.5).min() >= 0.5
    assert np.isnan(Trials([]).mean("number"))


def test_refused_trials_beyond_the_studys_share_miss_a_bar(tmp_path, monkeypatch):
    def refused(most):
        study = replace(NUMBERS, most_refused=most)
        monkeypatch.setattr("fakes.studies.conducting.study_called", lambda _: study)
        return conduct("numbers", runs=40, folder=tmp_path, plot=False).figures[-1]

    assert 15 < refused(0.5).value < 35
    assert refused(0.5).ok
    assert not refused(0.1).ok


def test_a_trial_may_not_measure_what_the_study_itself_writes_down():
    clashing = replace(NUMBERS, trial=lambda *_: {"refused": 1.0})
    with pytest.raises(ValueError, match="measures refused"):
        run_trials(clashing, 1, 0)


def test_progress_ends_with_all_trials():
    told = []
    run_trials(NUMBERS, 5, 1, report=lambda done, total: told.append((done, total)))
    assert told[-1] == (10, 10)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


@pytest.mark.parametrize(("runs", "workers"), [(0, 1), (1, 0)])
def test_counts_below_one_are_refused(runs, workers):
    with pytest.raises(InputError, match="at least 1"):
        run_trials(NUMBERS, runs, 0, workers=workers)


def test_a_bar_is_cleared_on_its_edge_missed_beyond_and_never_by_nan():
    assert Figure("f", 2.0, at_least=1.0, at_most=2.0).ok is True
    assert Figure("f", 2.1, at_most=2.0).ok is False
    assert Figure("f", float("nan"), at_most=2.0).ok is False
    assert Figure("f", 3.0).ok is None
    assert Figure("f", float("nan")).as_json()["value"] is None


def test_figure_4_comes_out_as_published(tmp_path):
    outcome = conduct("fig4", runs=300, folder=tmp_path)
    assert value(outcome, "mean") == pytest.approx(0.155, abs=0.012)
    assert 0.1 <= value(outcome, "mode") <= 0.2
    assert 0.33 <= value(outcome, "largest") <= 0.6
    assert value(outcome, "rms / Cramer-Rao bound") == pytest.approx(1, abs=0.08)
    assert outcome.files[1].read_bytes().startswith(PNG)
    with outcome.files[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 300
    errors = [float(row["error_mm"]) for row in rows]
    assert np.mean(errors) == value(outcome, "mean")


@pytest.mark.parametrize("name", sorted(STUDIES))
def test_every_study_runs_and_draws_and_its_figures_are_json(name, tmp_path):
    outcome = conduct(name, runs=1, folder=tmp_path / "made", workers=1)
    assert [path.name for path in outcome.files] == [f"{name}.csv", f"{name}.png"]
    assert outcome.files[1].read_bytes().startswith(PNG)
    result = json.loads(json.dumps(outcome.to_json(), allow_nan=False))
    assert result["runs"] == 1
    assert result["figures"][-1]["name"] == "trials refused"


def test_trials_are_pure():
    for name in ("fig4", "table3", "experiment-a"):
        study = STUDIES[name]
        again = [study.trial(SeedSequence(5), study.cases[0]) for _ in range(2)]
        assert again[0] == again[1]


def test_tables_2_and_3_are_listed_as_in_the_paper(tmp_path):
    table_2 = conduct("experiment-a", runs=2, folder=tmp_path, plot=False)
    tcp = [value(table_2, f"CAD: {axis}") for axis in "xyz"]
    for method in ("conventional", "universal"):
        found = [[value(table_2, f"{method} {k}: {a}") for a in "xyz"] for k in range(1, 9)]
        errors = [value(table_2, f"{method} {k}: error") for k in range(1, 9)]
        np.testing.assert_allclose(np.linalg.norm(np.subtract(found, tcp), axis=1), errors)
    table_3 = conduct("table3-means", runs=1, folder=tmp_path, plot=False)
    for method in ("conventional", "special"):
        answers = [[value(table_3, f"{method} {k}: {a}") for a in "xy"] for k in range(1, 6)]
        distances = np.linalg.norm(np.subtract(answers, np.mean(answers, axis=0)), axis=1)
        listed = [value(table_3, f"{method} {k}: from the mean") for k in range(1, 6)]
        np.testing.assert_allclose(distances, listed, atol=1e-9)
        figure = value(table_3, f"4-axis: {method}, from the mean of five")
        assert figure == pytest.approx(distances.mean())


def test_the_operator_saves_nine_minutes_without_a_hand_eye_step(tmp_path):
    outcome = conduct("table4", folder=tmp_path, plot=False)
    assert value(outcome, "conventional") == pytest.approx(15)
    assert value(outcome, "special") == pytest.approx(8.5)
    assert value(outcome, "joint, no hand-eye step") == pytest.approx(5.6)
    assert outcome.ok


def test_a_misspelt_name_lists_the_studies_and_the_likely_one():
    with pytest.raises(
        InputError, match=r"did you mean 'table3'\? There are: fig4, fig5, fig10, exp"
    ):
        study_called("tabel3")


def test_without_matplotlib_the_remedy_is_told_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(InputError, match="--no-plot"):
        conduct("fig4", runs=1, folder=tmp_path)
    assert conduct("fig4", runs=1, folder=tmp_path, plot=False).files[0].exists()


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        conduct("fig4", runs=1, folder=tmp_path / "file")
