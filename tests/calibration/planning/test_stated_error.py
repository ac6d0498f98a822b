"""Advice and budget give one figure for one thing, and every figure says in one wording what it includes."""

import numpy as np
import pytest

from fakes.world.simulation import Simulation
from vgrd.calibration.joint import calibrate_joint
from vgrd.calibration.planning import Job, PredictedError, error_budget, picture_of
from vgrd.calibration.planning.advice import advise_session
from vgrd.calibration.stated_error import THIS_PICTURE, each_target, u95_in_words
from vgrd.model import Policy


@pytest.fixture(scope="module")
def recording():
    cell = Simulation(3)
    return cell.record(looks=6, spins=5, wrists=[cell.wrist(0.3) for _ in range(8)])


@pytest.mark.parametrize("policy", [Policy.FIXED, Policy.FOLLOW])
@pytest.mark.parametrize("turn_rad", [0.0, 1.5])
def test_the_budget_without_assumed_errors_is_what_advice_predicts(recording, policy, turn_rad):
    fit = calibrate_joint(recording)
    job = Job(policy, angles_rad=(turn_rad,))
    foresight = PredictedError(fit, job)
    predicted = foresight.target_errors_mm(foresight.covariance, job)
    budget = error_budget(fit, picture_of(fit, turn_rad), policy)
    told = dict(zip(budget.targets, budget.u95_mm, strict=True))
    assert told == pytest.approx(predicted, rel=1e-3)


def test_advice_says_what_its_figure_includes(recording):
    told = advise_session(recording).to_json()
    assert told["u95_includes"] == (
        "95 % of the misses of each target with the object turned by 0 and 115 degrees, mean of both, policy fixed, "
        "without holes in the pictures, without assumed errors of print, intrinsics and drift"
    )
    assert min(told["predicted_u95_mm"].values()) > 0


def test_the_wording_tells_holes_and_what_is_assumed():
    words = u95_in_words(THIS_PICTURE, Policy.FOLLOW, 29)
    assert "policy follow, with 29 sightings of holes, without assumed" in words
    assert ", with assumed errors" in u95_in_words(
        each_target(float(np.degrees(1.0))), Policy.FIXED, 0, assumes=True
    )
