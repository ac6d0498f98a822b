"""Errors that touches with like orientations share: what a distorted field or a bent arm does to the TCP.

Such errors do not average out over many touches. The covariance by groups (Liang and Zeger 1986) takes the touches
of a group as one observation, whatever their errors have in common.
"""

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.levels import wider_by_freedom
from vgrd.calibration.tcp.touch_levels import TouchRows
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.covariance import dimensions_of

_HALVINGS = 4  # 16 groups: fewer tell their own scatter badly, more are alike themselves
_LEAST = 4  # touches in a group: below it nobody can tell what they share


def grouped_covariance(
    rows: TouchRows, used: NDArray[np.bool_], rotations: Array, unknowns: slice
) -> Array | None:
    """Covariance of some unknowns by groups of like orientations, its own freedom included; None for few touches.

    rows: whitened, of m touches; rotations: (m, 3, 3) of the wrist.
    """
    some = rows.some_of(used)
    groups = _like_groups(rotations, np.flatnonzero(used))
    if len(some.residuals) == 0 or min(map(len, groups)) < _LEAST:
        return None
    group_of = np.full(len(used), -1)
    for k, group in enumerate(groups):
        group_of[group] = k
    gain = np.linalg.pinv(some.jacobian)[unknowns]
    moves = gain * some.residuals
    shared = np.zeros((len(groups), len(gain)))
    np.add.at(shared, group_of[some.touch_of], moves.T)
    freedom = len(groups) - some.jacobian.shape[1]
    covariance = shared.T @ shared * len(groups) / freedom
    return np.asarray(covariance * wider_by_freedom(freedom, dimensions_of(covariance)) ** 2)


def _like_groups(rotations: Array, chosen: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """The chosen touches, halved again and again where their orientations differ most."""
    turns = np.array([log_rotation(R @ rotations[chosen[0]].T) for R in rotations[chosen]])
    groups = [np.arange(len(chosen))]
    for _ in range(_HALVINGS):
        halves = []
        for group in groups:
            about = turns[group] - turns[group].mean(axis=0)
            along = about @ np.linalg.svd(about, full_matrices=False)[2][0]
            order = np.argsort(along, kind="stable")
            halves += [group[order[: len(order) // 2]], group[order[len(order) // 2 :]]]
        groups = halves
        if min(map(len, groups)) < 2:
            break
    return [chosen[group] for group in groups]
