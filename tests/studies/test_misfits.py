from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.conducting import conduct
from fakes.studies.misfits import study as misfits
from fakes.studies.misfits.cell import MisfitCell
from fakes.studies.misfits.judging import Answer, Judged
from fakes.studies.misfits.worlds import ROWS, Move, Touching, World
from fakes.studies.study import Trials
from vgrd.judging.findings import KINDS
from vgrd.model import Link


def cell(seed=1, **differs):
    return MisfitCell(SeedSequence(seed), World(**differs), looks=8, pictures=28)


def touch_misses(**differs):
    drawing = cell(**differs)
    return np.array([drawing.touch_miss() for _ in range(4000)])


def test_touches_miss_by_what_the_world_says_and_state_what_the_file_says():
    stated_mm = cell().sigmas_mm[0]
    assert touch_misses(touch_times=2).std() == pytest.approx(2 * stated_mm, rel=0.05)
    tails = touch_misses(touching=Touching.TAILS)
    assert np.percentile(np.abs(tails), 99.8) > 4 * stated_mm
    far = np.linalg.norm(touch_misses(touching=Touching.OUTLIERS), axis=1) > 6 * stated_mm
    assert 0.05 < far.mean() < 0.1
    touch = cell(touch_times=2).touch("P1", np.eye(3))
    assert touch.lateral_sigma_mm == pytest.approx(stated_mm, rel=0.02)


def test_the_file_has_the_centre_wrong_and_the_object_turns_about_the_true_one():
    drawing = cell(center_sigma_mm=0.0, center_mm=1.0)
    stated = drawing.facts().object.center_in_object
    assert np.linalg.norm(stated) == pytest.approx(1.0)
    assert drawing.base_from_object(1.0).translation == pytest.approx(drawing.center_in_base)


def test_one_seed_draws_one_cell():
    a, b = (cell(center_mm=1.0).facts().object.center_in_object for _ in range(2))
    assert np.array_equal(a, b)


def test_causes_are_codes_of_findings_or_links():
    names = set(KINDS) | {link.value for link in Link}
    for row in ROWS.values():
        assert row.causes <= names


def judged(*within, accepted=True, told=(), links=()):
    return Judged(accepted, frozenset(told), tuple(Answer(w, 0.3, links) for w in within))


def test_a_session_that_misses_is_caught_only_when_refused_by_name():
    misses = [True] * 4 + [False] * 6
    named = {"touch_outlier"}
    assert judged(*misses, told=named).row(named)["caught"] == 0
    assert judged(*misses, accepted=False, told=named).row(named)["caught"] == 1
    assert judged(*misses, accepted=False, told={"noisy"}).row(named)["caught"] == 0
    assert judged(*misses, told={"tag B"}, links=("tag B",)).row({"tag B"})["caught"] == 1


def test_a_session_that_holds_is_refused_needlessly():
    holds = [True] * 9 + [False]
    assert judged(*holds).row(set())["needless"] == 0
    assert judged(*holds, accepted=False).row(set())["needless"] == 1
    assert judged(*holds, links=("camera",)).row(set())["needless"] == 1
    assert Judged(False, frozenset({"NotObservable"})).row(set())["needless"] == 0


def test_a_row_passes_by_its_radii_or_by_what_it_catches():
    row = judged(*[True] * 19, False).row(set())
    missed = judged(*[True] * 5, *[False] * 5).row(set())
    caught = {**missed, "caught": 1.0}

    def honest(*rows):
        trials = Trials([{"world": "touch sigma x 2", "refused": 0.0, **r} for r in rows])
        figures = misfits._of_row(trials, "touch sigma x 2")
        return next(f for f in figures if f.name.endswith("within, or caught"))

    assert honest(row, row).ok
    assert honest(caught, caught).ok
    assert not honest(caught, missed).ok


def test_the_catalogue_runs_and_draws(tmp_path, monkeypatch):
    few = replace(misfits.STUDY, cases=({"world": "touch sigma x 2", "part": 0},))
    monkeypatch.setattr("fakes.studies.conducting.study_called", lambda _: few)
    outcome = conduct("misfits", runs=2, folder=tmp_path)
    figures = {f.name: f.value for f in outcome.figures}
    assert 0 < figures["touch sigma x 2: u95"] < 1
    assert 0 <= figures["touch sigma x 2: truth within u95"] <= 100
    assert outcome.files[1].read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("move", [Move.BEFORE, Move.DURING, Move.AFTER])
def test_the_camera_is_knocked_once_and_when_it_should(move):
    drawing = cell(move=move, camera_mm=0.5)
    start, places = drawing.base_from_camera, []
    for _ in range(30):
        drawing.observe(drawing.standing, 0.0)
        places.append(np.linalg.norm((start.inverse() @ drawing.base_from_camera).translation))
    first = int(np.flatnonzero(places)[0])
    assert places[first:] == pytest.approx([0.5] * (30 - first), rel=1e-3)
    assert {Move.BEFORE: first == 8, Move.DURING: 8 < first < 28, Move.AFTER: first == 28}[move]
