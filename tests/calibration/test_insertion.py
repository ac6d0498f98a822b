"""How often a part goes into its hole: against draws, against known formulas, and through advice and answers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fakes.studies.robustness.bare_targets import without_cad
from fakes.world.noise import FINE
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.insertion import insertion_odds, insertion_of
from vgrd.calibration.joint import calibrate_joint
from vgrd.calibration.planning import (
    Job,
    PredictedError,
    advise_session,
    further_touches,
    predicted_insertions,
)
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import InputError
from vgrd.model import Policy
from vgrd.solving.insertions import insertion_sentences

UP = np.array([0.0, 0.0, 1.0])
SIGMAS = st.floats(1e-3, 2.0)


def with_clearance(recording, clearance_mm, names=("P1", "P2", "P3", "P4", "P5", "P6")):
    spec = recording.facts.object
    targets = {
        name: replace(target, clearance_mm=clearance_mm if name in names else None)
        for name, target in spec.targets.items()
    }
    facts = replace(recording.facts, object=replace(spec, targets=targets))
    return replace(recording, facts=facts)


def taught(seed=0, touches=6, clearance_mm=0.4):
    sim = Simulation(seed, vision=FINE, one_axis=True)
    wrists = [WORK_ROTATION] * touches
    return sim, with_clearance(sim.record(wrists=wrists), clearance_mm)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(sigma=SIGMAS, clearance_mm=st.floats(0.01, 5.0))
def test_a_round_scatter_gives_the_law_of_rayleigh(sigma, clearance_mm):
    odds = insertion_odds(sigma**2 * np.eye(3), UP, clearance_mm)
    assert odds.clean == pytest.approx(-np.expm1(-((clearance_mm / 2 / sigma) ** 2) / 2), abs=1e-9)
    assert odds.failed == pytest.approx(np.exp(-((clearance_mm / sigma) ** 2) / 2), abs=1e-9)
    assert odds.clean + odds.touching + odds.failed == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(6))
def test_any_scatter_gives_what_draws_give_and_the_height_does_not_count(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed).as_matrix()
    sigmas = rng.uniform(0.02, 0.3, 3)
    covariance = R @ np.diag(sigmas**2) @ R.T
    axis = Rotation.random(random_state=seed + 100).as_matrix()[:, 2]
    draws = rng.multivariate_normal(np.zeros(3), covariance, 200_000)
    lateral = np.linalg.norm(draws - np.outer(draws @ axis, axis), axis=1)
    odds = insertion_odds(covariance, axis, 0.4)
    assert odds.clean == pytest.approx(np.mean(lateral <= 0.2), abs=0.005)
    assert odds.failed == pytest.approx(np.mean(lateral > 0.4), abs=0.005)
    higher = insertion_odds(covariance + 9 * np.outer(axis, axis), axis, 0.4)
    assert higher.clean == pytest.approx(odds.clean, abs=1e-9)


def test_a_scatter_along_a_line_gives_the_normal_law():
    odds = insertion_odds(np.diag([0.04, 0.0, 0.0]), UP, 0.4)
    assert odds.clean == pytest.approx(0.6827, abs=1e-3)
    assert insertion_odds(np.zeros((3, 3)), UP, 0.4).clean == 1.0


@pytest.mark.parametrize("clearance_mm", [0.0, -0.4, np.nan, np.inf])
def test_a_clearance_is_a_length(clearance_mm):
    with pytest.raises(InputError, match="clearance"):
        insertion_odds(np.eye(3), UP, clearance_mm)


def test_more_touches_make_more_of_them_clean_and_the_number_told_is_the_least():
    _, recording = taught()
    result = calibrate_joint(recording, find_noise=False)
    foresight = PredictedError(result, Job())
    count = further_touches(result, foresight, 0.95)
    assert count is not None
    assert count > 3
    assert further_touches(result, foresight, 0.0) == 0
    assert further_touches(result, foresight, 1.0) is None

    def least(touches):
        more = calibrate_joint(taught(touches=touches)[1], find_noise=False)
        job = PredictedError(more, Job())
        return min(o.clean for o in predicted_insertions(more, job, job.covariance).values())

    assert least(6) < 0.95
    assert least(6 + count) == pytest.approx(0.95, abs=0.01)


def test_advice_and_answer_tell_it_of_targets_that_have_a_clearance_and_of_no_others():
    sim, recording = taught()
    some = with_clearance(recording, 0.4, ("P2", "P5"))
    told = advise_session(some).to_json()
    assert sorted(told["insertions"]) == ["P2", "P5"]
    assert "touch" in told["insertions_in_words"]
    assert "insertions" not in advise_session(with_clearance(recording, None)).to_json()
    calibration = calibrate_system(some)
    tag_b = sim.request().seen.tag_b
    odds = {
        name: insertion_of(
            expected_coordinate(calibration, name, tag_b, Policy.FIXED),
            some.facts.tool,
            some.facts.object.targets[name].clearance_mm,
        )
        for name in ("P1", "P2")
    }
    assert odds["P1"] is None
    assert 0.5 < odds["P2"].clean < 1
    sentences = insertion_sentences(calibration, some, Policy.FIXED)
    assert [sentence[:2] for sentence in sentences] == ["P2", "P5"]


def test_a_wide_hole_needs_no_touch_more_and_the_advice_says_so():
    _, recording = taught(clearance_mm=3.0)
    words = advise_session(recording).to_json()["insertions_in_words"]
    assert words.startswith("95 % of insertions")


def test_advice_goes_on_while_a_target_without_cad_is_not_touched_yet():
    sim, _ = taught()
    names = ["P1", "P2", "P3", "P4", "P5", "P1"]
    recording = without_cad(with_clearance(sim.record(names=names), 0.4), ("P6",))
    told = advise_session(recording).to_json()
    assert sorted(told["insertions"]) == ["P1", "P2", "P3", "P4", "P5"]
    assert "P6" in told["next"]["words"]
