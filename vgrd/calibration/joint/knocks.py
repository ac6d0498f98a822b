"""A fixed camera that was knocked while it was taught: when it moved, found by what its pictures contradict.

Every time between two pictures may have been that of a knock. How much better the pictures would agree if the
camera stood elsewhere before it follows from the fit without it: squares of six degrees of freedom, in sigmas of
sensors and arm (a score test). What a few bad samples explain as well is left to these.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.joint.fit import JointFit, whiten_arm
from vgrd.calibration.joint.problem import SAMPLED, EvidenceKind, JointData
from vgrd.calibration.joint.rows import displacement_jacobian
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CHANCE
from vgrd.model import (
    Finding,
    Observation,
    Recording,
    Stability,
    TagObservation,
    Touch,
    frozen_array,
)

_MOST = 4  # of one session: a camera that is knocked more often is not fixed
_UNTOLD = 1e-6  # share of a displacement that other unknowns take up: rounding above it
_BAD_SAMPLE = (
    1e-4  # a guess: how many are bad; a knock between two pictures is rarer (CHANCE / pictures)
)
_JUMP_MM = 5.0  # and as many mrad: above what a chain over one picture errs
_MOVED_BY = (EvidenceKind.HAND_EYE, EvidenceKind.REFERENCE, EvidenceKind.SPINS)

Moves = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CameraMove:
    """The camera was moved by mm and rad between two pictures, by their names."""

    mm: float
    rad: float
    before: str
    after: str


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The fit of all samples with the camera moved at these stamps, and that without the bad ones."""

    moves_s: Moves
    optimum: JointFit
    screened: JointFit


def follow(trial: Trial, solve: Callable[[Moves], Trial]) -> Trial:
    """The trial with as many knocks of the camera as explain what it would contradict.

    trial: with those that are known; solve: the same with others, which may raise CalibrationError.
    """
    while len(trial.moves_s) < _MOST:
        better = next(_better(trial, solve), None)
        if better is None:
            break
        trial = better
    return trial


def _better(trial: Trial, solve: Callable[[Moves], Trial]) -> Iterator[Trial]:
    """With one knock more, where it explains more; as all samples suspect it, or as the good ones do."""
    first_s = suspicion(trial.optimum)
    all_used = all(sample.used for sample in trial.screened.samples)
    second_s = None if all_used else suspicion(trial.screened)
    for stamp_s in dict.fromkeys((first_s, second_s)):
        if stamp_s is None:
            continue
        with suppress(CalibrationError):
            other = solve(tuple(sorted((*trial.moves_s, stamp_s))))
            if _is_told(other) and _explains_more(other.screened, trial.screened):
                yield other


def _is_told(trial: Trial) -> bool:
    """Whether tag A agrees in each place; an object that moved is explained without it."""
    of_a = EvidenceKind.HAND_EYE
    every, used = (
        np.bincount(
            np.searchsorted(trial.moves_s, fit.data.stamps_s[of_a], side="right"),
            minlength=len(trial.moves_s) + 1,
        )
        for fit in (trial.optimum, trial.screened)
    )
    return bool((2 * used > every).all())


def suspicion(fit: JointFit) -> float | None:
    """Stamp of the first picture after a knock that is likelier than chance, None without one."""
    stamps_s = _candidates(fit.data)
    if not len(stamps_s):
        return None
    squares, freedoms = squares_of(fit, stamps_s)
    limits = {freedom: _limit(len(stamps_s), freedom) for freedom in set(freedoms.tolist())}
    excess = squares - np.array([limits[freedom] for freedom in freedoms.tolist()])
    best = int(np.argmax(excess))
    return float(stamps_s[best]) if excess[best] > 0 else None


def jumps(data: JointData, taught_from_camera: Sequence[Pose]) -> Moves:
    """Stamps at which a camera that was followed in every picture by itself moved far."""
    poses = _in_order(data, taught_from_camera)
    moves_s = [
        stamp
        for stamp, here, there in zip(data.places.first_s, poses[:-1], poses[1:], strict=True)
        if max(here.distance(there)[0], 1e3 * here.distance(there)[1]) > _JUMP_MM
    ]
    return tuple(moves_s[:_MOST])


def moves_of(fit: JointFit) -> list[CameraMove]:
    """How the camera moved while it was taught, in the order of time."""
    data = fit.data
    named = sorted(
        {
            (float(stamp), name)
            for kind in _MOVED_BY
            for stamp, name in zip(data.stamps_s[kind], data.names[kind], strict=True)
        }
    )
    poses = _in_order(data, fit.state.taught_from_camera)
    moves = []
    for stamp, here, there in zip(data.places.first_s, poses[:-1], poses[1:], strict=True):
        mm, rad = here.distance(there)
        before = [name for s, name in named if s < stamp]
        after = [name for s, name in named if s >= stamp]
        moves.append(CameraMove(mm, rad, before[-1] if before else "", after[0] if after else ""))
    return moves


def camera_moves(fit: JointFit) -> tuple[Finding, ...]:
    """What is told of a fixed camera that was knocked; nothing of one that people move."""
    if fit.recording.facts.camera_stability is Stability.MOVABLE:
        return ()
    return tuple(
        finding(
            "camera_moved",
            f"the camera moved by {move.mm:.2g} mm and {1e3 * move.rad:.2g} mrad between "
            f"{move.before} and {move.after}",
        )
        for move in moves_of(fit)
    )


def as_seen_in_the_end(fit: JointFit, recording: Recording) -> Recording:
    """The recording as the camera would have seen it from where it stands in the end."""
    first_s, poses = fit.data.places.first_s, _in_order(fit.data, fit.state.taught_from_camera)

    def moved(tag: TagObservation | None, D: Pose) -> TagObservation | None:
        if tag is None:
            return None
        G = D.adjoint()
        covariance = frozen_array(G @ tag.covariance @ G.T, 6, 6)
        return replace(tag, camera_from_tag=D @ tag.camera_from_tag, covariance=covariance)

    def seen(picture: Observation) -> Observation:
        D = poses[int(np.searchsorted(first_s, picture.stamp_s, side="right"))]
        return replace(picture, tag_a=moved(picture.tag_a, D), tag_b=moved(picture.tag_b, D))

    def touched(touch: Touch) -> Touch:
        picture = touch.observation
        return touch if picture is None else replace(touch, observation=seen(picture))

    return replace(
        recording,
        looks=tuple(map(seen, recording.looks)),
        spins=tuple(map(seen, recording.spins)),
        touches=tuple(map(touched, recording.touches)),
        points=tuple(map(touched, recording.points)),
        verifications=tuple(map(touched, recording.verifications)),
    )


def _in_order(data: JointData, taught_from_camera: Sequence[Pose]) -> list[Pose]:
    """Displacements of all places, the reference among them."""
    poses = list(taught_from_camera)
    poses.insert(data.places.reference, Pose.identity())
    return poses


def pictures_of(data: JointData) -> list[float]:
    """Stamps of all pictures that count, in their order."""
    stamps_s = np.unique(np.concatenate([data.stamps_s[kind] for kind in _MOVED_BY]))
    return [float(stamp) for stamp in stamps_s]


def _candidates(data: JointData) -> Array:
    """Stamps (c,) of pictures before and after which tag A was seen from one place: it tells of a knock.

    Without it an object that moved would look the same.
    """
    stamps_s, of_a = np.array(pictures_of(data)), data.stamps_s[EvidenceKind.HAND_EYE]
    first_s = np.array(data.places.first_s)
    place, place_of_a = (np.searchsorted(first_s, s, side="right") for s in (stamps_s, of_a))
    same = place[:, None] == place_of_a
    before = (same & (of_a < stamps_s[:, None])).any(axis=1)
    since = (same & (of_a >= stamps_s[:, None])).any(axis=1)
    return np.asarray(stamps_s[before & since])


def squares_of(fit: JointFit, stamps_s: Array) -> tuple[Array, Array]:
    """By how much the squares fall if the camera was moved at each stamp (c,), and degrees of freedom."""
    N = _displacements(fit, stamps_s)
    rows, c = len(N), len(stamps_s)
    shared = fit.jacobian[:rows].T @ N
    taken_up = fit.covariance / fit.variance_scale @ shared
    by_split = N.reshape(rows, c, 6).transpose(1, 2, 0)
    shared, taken_up = (part.reshape(-1, c, 6).transpose(1, 2, 0) for part in (shared, taken_up))
    whole = by_split @ by_split.transpose(0, 2, 1)
    scale = np.sqrt(np.diagonal(whole, axis1=1, axis2=2))
    scale = np.where(scale > 0, scale, 1.0)
    left = (whole - shared @ taken_up.transpose(0, 2, 1)) / (scale[:, :, None] * scale[:, None])
    values, vectors = np.linalg.eigh(left)
    gradient = (fit.whitened[:rows] @ N).reshape(c, 6) / scale
    parts = np.einsum("cij,ci->cj", vectors, gradient)
    told = values > _UNTOLD
    squares = np.sum(parts**2 / np.where(told, values, np.inf), axis=1)
    return squares, told.sum(axis=1)


def _displacements(fit: JointFit, stamps_s: Array) -> Array:
    """Derivative (k, 6 c), in sigmas, by a displacement of the camera in its place before each stamp."""
    data, k = fit.data, len(fit.arm_factor)
    J = fit.jacobian
    if k:
        J = np.vstack([fit.arm_factor @ J[:k], J[k:]])
    moved = displacement_jacobian(fit.state, data, J, fit.layout)
    stamp, first_s = data.row_stamps(), data.places.first_s
    place, own = (np.searchsorted(first_s, s, side="right") for s in (stamp, stamps_s))
    is_moved = (stamp[:, None] < stamps_s) & (place[:, None] == own)
    N = is_moved[:, :, None] * moved[:, None, :]
    return whiten_arm(fit.arm_factor, N.reshape(len(moved), -1))


def _limit(candidates: int, freedom: int) -> float:
    """Squares that the best of so many times reaches by chance once in a thousand sessions."""
    return chi2_quantile(1 - CHANCE / candidates, freedom) if freedom else np.inf


def _explains_more(fit: JointFit, other: JointFit) -> bool:
    """Whether one knock more is worth what it explains, in sigmas that the samples themselves have."""
    noise = max(fit.noise_scale, 1.0) ** 2
    return _total(fit, noise) < _total(other, noise)


def _total(fit: JointFit, noise: float) -> float:
    """Squares of a fit, and what its knocks and the samples that it leaves out must be worth."""
    left_out = sum(
        chi2_quantile(1 - _BAD_SAMPLE, SAMPLED[EvidenceKind(sample.kind)])
        for sample in fit.samples
        if not sample.used
    )
    knocks = fit.data.places.displaced
    return 2 * fit.cost / noise + left_out + knocks * _limit(len(_candidates(fit.data)), 6)
