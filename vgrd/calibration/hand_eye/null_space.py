"""Translations that stay open where the wrist does not turn about two axes: 4-axis arms, portals.

Camera and target can then be moved together, along the one axis (4-axis) or in every direction (no
turn at all), and no picture changes.
"""

from collections.abc import Sequence

import numpy as np

from vgrd.calibration.hand_eye.certificate import translation_rows
from vgrd.calibration.observability import (
    Axes,
    check_hand_eye_motion,
    hand_eye_observability,
    missing_rotation,
    turned_axes,
)
from vgrd.errors import NotObservable
from vgrd.geometry import Array, Pose
from vgrd.judging.findings import finding
from vgrd.model import Finding, Mount

_TRANSLATION_ONLY = 0.05  # rad, 3 degrees: below it the wrist was not turned on purpose
_ROUNDING_RAD = 1e-3  # turns below it, rms, are taken for rounding of the poses


def open_translations(
    wrists: Sequence[Pose], flange_motions: Sequence[Pose], allowed: int
) -> Array:
    """Directions (k, 6) of (t_X, t_Y) that the motion leaves open, orthonormal rows, k <= allowed.

    moves: M of `vgrd.calibration.hand_eye.pose_pairs`. Raises TooFewObservations, or NotObservable, which names
    the missing motion, where more stays open or the camera's rotation does. A direction that small turns
    about other axes tell badly is not open: its covariance is large.
    """
    if allowed == 0:
        check_hand_eye_motion(wrists)
        return np.zeros((0, 6))
    rank = hand_eye_observability(wrists)
    turning = rank.undetermined.reshape(-1, 2, 2, 3)[:, :, 1]
    if np.any(np.linalg.norm(turning, axis=2) > _TRANSLATION_ONLY):
        raise _open(rank.rank, f"leave the camera's rotation open: {_missing_shift(wrists)}")
    _, s, Vt = np.linalg.svd(
        translation_rows(np.array([move.rotation.T for move in flange_motions]))
    )
    null_space = Vt[s < _ROUNDING_RAD * np.sqrt(len(flange_motions) / 2)]
    if len(null_space) > allowed:
        turns = [wrist.rotation for wrist in wrists]
        raise _open(
            12 - len(null_space), f"leave where the camera is open: {missing_rotation(turns)}"
        )
    return _signed(null_space)


def _open(rank: int, consequence: str) -> NotObservable:
    message = f"hand-eye: the robot poses determine {rank} of 12 unknowns and {consequence}"
    return NotObservable(message, rank=rank, unknowns=12)


def _missing_shift(wrists: Sequence[Pose]) -> str:
    axes, axis = turned_axes([wrist.rotation for wrist in wrists])
    if axes is not Axes.ONE:
        return "move the wrist by 100 mm or more along two directions that are not in line"
    x, y, z = axis
    return (
        f"the wrist turned about the axis ({x:.2f}, {y:.2f}, {z:.2f}) of the base without "
        "moving across it; move it by 100 mm or more across the axis, at two or more turns"
    )


def _signed(null_space: Array) -> Array:
    """Each direction with the largest component of its target half positive."""
    signs = [np.sign(row[3:][np.argmax(np.abs(row[3:]))]) for row in null_space]
    return null_space * np.reshape(signs, (-1, 1))


def without_part_along(X: Pose, Y: Pose, null_space: Array) -> tuple[Pose, Pose]:
    """Both poses moved along what is free (k, 6) until the target's origin has no part of it."""
    if not len(null_space):
        return X, Y
    amount = np.linalg.lstsq(null_space[:, 3:].T, Y.translation, rcond=None)[0]
    shift = amount @ null_space
    return (
        Pose(X.rotation, X.translation - shift[:3]),
        Pose(Y.rotation, Y.translation - shift[3:]),
    )


def determined_steps(null_space: Array, extra: int) -> Array:
    """Orthonormal columns (12 + extra, 12 + extra - k): all steps of a fit but along `null_space` (k, 6)."""
    blocked = np.zeros((len(null_space), 12 + extra))
    blocked[:, [0, 1, 2, 6, 7, 8]] = null_space
    if not len(null_space):
        return np.eye(12 + extra)
    return np.asarray(np.linalg.svd(blocked)[2][len(null_space) :].T)


def undetermined_in_words(mount: Mount, null_space: Array) -> tuple[str, ...]:
    """Each free direction (k, 6) as a translation in the base, where camera or target stands still."""
    base = slice(0, 3) if mount is Mount.EYE_TO_HAND else slice(3, 6)
    return tuple(f"translation along {_line(row[base])} of base" for row in null_space)


def null_space_findings(mount: Mount, null_space: Array) -> tuple[Finding, ...]:
    """What stays open and how to learn it, in words; empty where nothing does."""
    if not len(null_space):
        return ()
    holder, other = ("wrist", "base") if mount is Mount.EYE_TO_HAND else ("base", "wrist")
    if len(null_space) > 1:
        message = (
            "the wrist did not turn: where the camera is stays open in all directions, its "
            f"rotation does not, and the target's origin is taken at the origin of the {holder}"
        )
        return (finding("position_free", message),)
    message = (
        f"the wrist turned about one axis only: the target's height along {_vector(null_space[0, 3:])} "
        f"of the {holder} stays open and is taken as 0 mm; the camera's place along "
        f"{_vector(null_space[0, :3])} of the {other} depends on it"
    )
    return (finding("height_free", message),)


def _vector(half: Array) -> str:
    x, y, z = np.round(half / np.linalg.norm(half), 2) + 0.0
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


def _line(half: Array) -> str:
    """A direction whose sign does not matter: the largest component positive."""
    return _vector(half * np.sign(half[np.argmax(np.abs(half))]))
