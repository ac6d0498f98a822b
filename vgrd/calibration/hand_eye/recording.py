"""Hand-eye from a recording of which nothing is stated but its numbers: noise levels come from the samples."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.hand_eye.certificate import certified_start
from vgrd.calibration.hand_eye.likelihood import HEAVY, Likelihood
from vgrd.calibration.hand_eye.null_space import determined_steps, open_translations
from vgrd.calibration.hand_eye.pose_pairs import HandEyeResult
from vgrd.calibration.hand_eye.recording_problem import RecordingProblem
from vgrd.calibration.hand_eye.recording_result import result_of
from vgrd.calibration.hand_eye.recording_search import TRIAL_STEPS, Found, kinds_of, likeliest
from vgrd.calibration.hand_eye.state import HandEye, flange_motion_of
from vgrd.calibration.observability import check_distinct
from vgrd.errors import CalibrationError, TooFewObservations
from vgrd.geometry import Array
from vgrd.geometry.camera import INTRINSICS

_REJECT_WEIGHT = 0.1  # a sample that counts less than a tenth is left out and named
_REJECT_ROUNDS = 3  # of leaving out, a bound only
_BEYOND_DOUBT = 10.0  # of minus twice a log-likelihood: odds of 150 to 1
_START_SIGMA_MM = 1.0  # of the start only, where their ratio says how to weigh: alike at 500 mm
_START_SIGMA_RAD = 2e-3  # see above


def calibrate_recording(problem: RecordingProblem) -> HandEyeResult:
    """Restricted maximum likelihood; samples that fit no common pose are left out with the reason.

    Raises TooFewObservations, NotObservable (names the missing motion) or InputError (one pose twice).
    """
    check_distinct(problem.names, problem.wrists)
    n = len(problem.names)
    unknowns = 12 + problem.blank.extra - problem.blank.points.size
    null_space = _open(problem, range(n))
    if 6 * n < unknowns + 1:
        raise TooFewObservations(
            f"{n} samples cannot determine {unknowns} unknowns: add samples or refine less"
        )
    state = _start(problem, null_space)
    used: list[int] = list(range(n))
    for _ in range(_REJECT_ROUNDS):
        found = likeliest(problem.chosen(used), state, null_space)
        state = found.state
        weights = _weights(problem, found)
        kept = [i for i in range(n) if weights[i] >= _REJECT_WEIGHT]
        if kept == used or not _determines(problem, kept):
            break
        null_space = _open(problem, kept)
        used = kept
    else:
        found = likeliest(problem.chosen(used), state, null_space)
    return result_of(problem, found, used, null_space)


def demands_refinement(problem: RecordingProblem, given: HandEyeResult) -> HandEyeResult | None:
    """The result with intrinsics refined where the samples leave no doubt that the given ones are off.

    No doubt: the likelihood of the target's poses in the pictures grows by more than six unknowns may
    cost (Schwarz 1978) and ten more, odds of 150 to 1. given: the result with the intrinsics as given.
    """
    camera = problem.blank.camera
    if camera is None:
        return None
    refined = replace(problem, blank=replace(problem.blank, refines_camera=True))
    if problem.start is None or not problem.start.refined:
        refined = replace(refined, start=given)
    enough = len(INTRINSICS) * np.log(6 * len(problem.names)) + _BEYOND_DOUBT
    used = [i for i, sample in enumerate(given.samples) if sample.used]  # the others prove nothing
    try:
        if _gain_at_once(replace(refined, start=given).chosen(used), given) < enough / 2:
            return None
        result = calibrate_recording(refined)
        if given.misfit - result.misfit <= enough:
            return None
        return replace(result, as_given=_as_given(problem, given, result))
    except CalibrationError:
        return None


def _as_given(
    problem: RecordingProblem, given: HandEyeResult, refined: HandEyeResult
) -> HandEyeResult:
    """The result with the intrinsics as given, once others are known to fit.

    The arm is as rough as the intrinsics that fit say; what the others cannot explain is left to the pictures.
    """
    arm = tuple(level for level in refined.levels if level.name.startswith("arm's"))
    return calibrate_recording(replace(problem, start=given, known=arm))


def _gain_at_once(refined: RecordingProblem, given: HandEyeResult) -> float:
    """How much squared misfit the intrinsics explain at the levels found without them."""
    state = _start(refined, given.null_space)
    basis = determined_steps(given.null_space, state.extra)
    likelihood = Likelihood(
        refined.mount, refined.wrists, refined.evidence, kinds_of(refined, state), basis
    )
    levels = 2 * np.log([level.ratio for level in given.levels])
    better = likelihood.descend(state, levels, TRIAL_STEPS)
    before, after = (likelihood.weighted(one, levels).d2 for one in (state, better))
    return float(before.sum() - after.sum())


def _open(problem: RecordingProblem, used: Sequence[int]) -> Array:
    wrists = [problem.wrists[i] for i in used]
    flange_motions = [flange_motion_of(problem.mount, wrist) for wrist in wrists]
    return open_translations(wrists, flange_motions, problem.allow_unobservable)


def _determines(problem: RecordingProblem, kept: Sequence[int]) -> bool:
    """Whether so few samples leave a fit: leaving out what cannot be spared proves nothing."""
    try:
        _open(problem, kept)
    except CalibrationError:
        return False
    return 6 * len(kept) > 12 + problem.blank.extra - problem.blank.points.size


def _start(problem: RecordingProblem, null_space: Array) -> HandEye:
    if problem.start is not None:
        result = problem.start
        camera = result.camera if problem.blank.refines_camera else problem.blank.camera
        return replace(
            problem.blank, X=result.mount_from_camera, Y=result.mount_from_target, camera=camera
        )
    best = certified_start(
        [flange_motion_of(problem.mount, wrist) for wrist in problem.wrists],
        problem.cameras,
        sigma_mm=_START_SIGMA_MM,
        sigma_rad=_START_SIGMA_RAD,
        null_space=null_space,
    )
    return replace(problem.blank, X=best.X, Y=best.Y, certificate=best.certificate)


def _weights(problem: RecordingProblem, found: Found) -> Array:
    """Weight of every sample as in a t distribution at the found levels, the unused ones too."""
    everything = found.likelihood.of_samples(problem.wrists, problem.evidence)
    d2 = everything.weighted(found.state, found.levels.log_variances).d2
    return np.asarray((HEAVY + 6) / (HEAVY + d2))
