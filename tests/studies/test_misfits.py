from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from fakes.studies.conducting import conduct
from fakes.studies.misfits import study as misfits
from fakes.studies.misfits.cell import MisfitCell
from fakes.studies.misfits.judging import Answer, Judged
from fakes.studies.misfits.prints import Print, seen_as
from fakes.studies.misfits.worlds import BEFORE, ROWS, Move, Touching, World
from fakes.studies.study import Trials
from fakes.world.simulation import TAG_B
from vgrd.geometry import Pose
from vgrd.judging.findings import KINDS
from vgrd.model import Link

K = np.array([[6500.0, 0, 2000], [0, 6500, 1500], [0, 0, 1]])
OBLIQUE = Pose.from_rotvec((2.9, 0.4, 0.3), (40, -60, 650))


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
    drawing = cell(center_drawn_mm=0.0, center_mm=1.0)
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


def test_a_clean_row_is_judged_by_its_alarms_and_by_what_doubt_costs():
    name = BEFORE

    def figures(u95_mm, told):
        row = {**judged(*[True] * 10, told=told).row(set()), "u95_mm": u95_mm}
        rows = [{"world": name, "refused": 0.0, **row}]
        return {f.name.removeprefix(f"{name}: "): f for f in misfits._of_row(Trials(rows), name)}

    good, bad = figures(0.36, {"flange_not_proven"}), figures(0.5, {"touch_outlier"})
    assert good["false alarms"].ok
    assert good["u95 over what it was"].ok
    assert not bad["false alarms"].ok
    assert not bad["u95 over what it was"].ok


def test_the_catalogue_runs_and_draws(tmp_path, monkeypatch):
    few = replace(misfits.STUDY, cases=({"world": "touch sigma x 2"},))
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


def seen(*, size=1.0, ink=(0.0, 0.0), focal=1.0, truth=OBLIQUE):
    K_true = K * np.array([[focal, 1, 1], [1, focal, 1], [1, 1, 1]])
    return seen_as(TAG_B, Print(size, np.array(ink)), truth, K_true, K)


def test_a_tag_as_stated_is_seen_where_it_is_and_a_larger_one_nearer():
    assert seen().matrix() == pytest.approx(OBLIQUE.matrix(), abs=1e-9)
    larger = seen(size=1.01)
    assert larger.translation == pytest.approx(OBLIQUE.translation / 1.01, rel=1e-9)
    assert larger.rotation == pytest.approx(OBLIQUE.rotation, abs=1e-9)


def test_a_longer_lens_than_the_file_says_brings_a_tag_on_its_axis_nearer():
    straight = Pose.from_rotvec((np.pi, 0, 0), (0, 0, 650))
    assert seen(focal=1.003, truth=straight).translation == pytest.approx((0, 0, 650 / 1.003))


def test_ink_across_one_axis_tilts_a_tag_and_ink_all_round_hardly_moves_it():
    def off(ink):
        return (OBLIQUE.inverse() @ seen(ink=ink)).log()

    both, x, y = off((0.01, 0.01)), off((0.01, 0.0)), off((0.0, 0.01))
    assert abs(x[2]) > 0.05
    assert np.linalg.norm(x[3:]) > 1e-3
    assert x + y == pytest.approx(both, abs=1e-3)
    assert np.linalg.norm(both[3:]) < 0.1 * np.linalg.norm(x[3:])
    assert off((-0.01, 0.0)) == pytest.approx(-x, rel=0.02, abs=1e-5)


def test_noise_is_three_times_what_is_stated():
    drawing, quiet = cell(vision_times=3), cell()
    truth = OBLIQUE.translation
    shifts = [
        drawing._see(TAG_B, OBLIQUE).camera_from_tag.translation - truth for _ in range(2000)
    ]
    stated = cell(seed=2)._see(TAG_B, OBLIQUE).covariance
    assert np.std(shifts, axis=0)[2] == pytest.approx(3 * quiet.vision.depth_mm, rel=0.1)
    assert drawing._see(TAG_B, OBLIQUE).covariance == pytest.approx(stated, rel=0.05, abs=1e-4)


def test_an_arm_on_its_way_is_told_where_it_is_20_ms_later_or_earlier():
    looks = cell(skew_s=0.02).looks(16)
    off = [
        np.linalg.norm(
            look.tag_a.camera_from_tag.translation - still.tag_a.camera_from_tag.translation
        )
        for look, still in zip(looks, again(looks), strict=True)
    ]
    assert 0.3 < np.median(off) < 5
    assert np.diff([look.stamp_s for look in looks]) == pytest.approx(0.3)


def again(looks):
    """The same poses seen at rest."""
    drawing = cell()
    return [drawing.observe(look.base_from_wrist, 0.0) for look in looks]


def test_the_axis_is_tilted_in_the_object_and_cad_is_off():
    drawing = cell(axis_tilt_deg=0.3)
    turn = drawing.base_from_object(np.pi).rotation
    assert np.degrees(np.arccos(turn[2, 2])) == pytest.approx(0.6, rel=1e-4)
    stated = cell(cad_mm=0.1).facts().object.targets
    off = [np.abs(stated[n].cad - t.cad) for n, t in drawing.targets.items()]
    assert 0.03 < np.mean(off) < 0.2


def test_every_misfit_has_a_row_and_every_row_but_the_clean_ones_a_cause():
    clean = [name for name, row in ROWS.items() if not row.causes]
    assert clean == ["clean, centre 0.02 stated", BEFORE, "clean"]
    differing = {
        f
        for row in ROWS.values()
        for f in World.__slots__
        if getattr(row.world, f) != getattr(World(), f)
    }
    assert differing == set(World.__slots__)
