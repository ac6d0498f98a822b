"""Expected coordinates straight from a fit, for studies and checks of a session."""

from dataclasses import replace

import numpy as np

from vgrd.calibration.joint.answers import Prediction
from vgrd.calibration.joint.fit import JointFit
from vgrd.calibration.joint.marginal import kept_columns, solution_of
from vgrd.calibration.joint.problem import target_of
from vgrd.calibration.joint.solution import JointSolution
from vgrd.calibration.touches import touched_orientation
from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Array
from vgrd.model import ExpectedCoordinate, Observation, Policy, Recording, TagObservation


def expected_by_joint(
    fit: JointFit,
    target: str,
    observation_now: Observation | TagObservation,
    policy: Policy = Policy.FIXED,
    base_from_work: Array | None = None,
) -> ExpectedCoordinate:
    """Flange pose at which the work tip meets the target in the picture given; Eq. 5 and 6.

    policy fixed: wrist as touched (or `base_from_work` (3, 3)); follow: it turns with the object;
    requested: exactly `base_from_work`. Raises InputError, TagNotSeen, or NotObservable where the
    answer depends on what the recording left undetermined.
    """
    facts = fit.recording.facts
    R_work = work_orientation(fit.recording, target, policy, base_from_work)
    tag_b = tag_b_of(observation_now)
    return solution_of(fit).expected_for(facts, target_of(facts, target), tag_b, policy, R_work)


def predict(
    fit: JointFit,
    solution: JointSolution,
    target: str,
    tag: TagObservation,
    policy: Policy,
    R_work: Array,
    *,
    refuse: bool = True,
) -> Prediction:
    """`JointSolution.predict` with derivatives by all unknowns of the fit, 0 by those of its spins.

    solution: as `solution_of(fit)`, made once for many predictions.
    """
    facts = fit.recording.facts
    prediction = solution.predict(
        facts, target_of(facts, target), tag, policy, R_work, refuse=refuse
    )
    columns = kept_columns(fit.layout)
    J, J_turn = np.zeros((3, fit.layout.size)), np.zeros((3, fit.layout.size))
    J[:, columns], J_turn[:, columns] = prediction.J_unknowns, prediction.J_turn_unknowns
    return replace(prediction, J_unknowns=J, J_turn_unknowns=J_turn)


def tag_b_of(picture: Observation | TagObservation) -> TagObservation:
    """Tag B of a picture; raises TagNotSeen."""
    tag = picture.tag_b if isinstance(picture, Observation) else picture
    if tag is None:
        raise TagNotSeen("tag B is not in the picture")
    return tag


def work_orientation(
    recording: Recording, name: str, policy: Policy, base_from_work: Array | None
) -> Array:
    """As asked for, as configured, or as touched: the most usual orientation of that target."""
    if base_from_work is not None:
        return np.asarray(base_from_work, dtype=np.float64)
    if policy is Policy.REQUESTED:
        raise InputError("policy 'requested' needs the orientation of the wrist: base_from_work")
    configured = target_of(recording.facts, name).base_from_work
    if configured is not None:
        return np.asarray(configured)
    return touched_orientation(recording.touches, name)
