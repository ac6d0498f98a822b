"""Drawn recordings of every kind, by numpy, scipy and cv2 alone: nothing of the solver that is judged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tests.benchmarks.hand_eye.recordings import Array, Recorded, matrix

ELSEWHERE = (40.0, 4.0)  # mm and degrees per axis by which a pose of another moment is off
JUDGED = 40  # samples of a kind, in as many recordings as it takes: of a dozen alone the luckiest of eight
# methods is a tenth better than it is


@dataclass(frozen=True)
class Drawn:
    """How a recording is drawn. arm: mm and degrees per axis; turns: degrees of tilt, one sigma.

    outliers: so many flange poses belong to another moment; size: of the target over the stated one;
    focal: of the camera over the stated one; pairs: mm and degrees of the target's pose where only that is told.
    """

    name: str
    count: int
    arm: tuple[float, float]
    px: float = 0.3
    in_hand: bool = False
    turns: float = 20.0
    away_mm: tuple[float, float] = (450.0, 800.0)
    corners: tuple[int, int, float] = (8, 6, 25.0)
    outliers: int = 0
    size: float = 1.0
    focal: float = 1.0
    pairs: tuple[float, float] | None = None


DRAWN = (
    Drawn("fine arm, 30", 30, (0.02, 0.01), 0.1),
    Drawn("fine arm, rough pixels, 8", 8, (0.05, 0.01), 2.0, in_hand=True),
    Drawn("industrial arm, 15", 15, (0.3, 0.03), 0.3, in_hand=True),
    Drawn("positions 2 mm, 20", 20, (2.0, 0.05), 0.3),
    Drawn("positions 10 mm, 25", 25, (10.0, 0.3), 1.0),
    Drawn("turns 1 degree, 12", 12, (0.5, 1.0), 0.2, in_hand=True),
    Drawn("rough all over, 6", 6, (2.0, 0.5), 1.0),
    Drawn("pixels 5, 40", 40, (0.1, 0.02), 5.0, in_hand=True, away_mm=(300, 500)),
    Drawn("small tilts, 20", 20, (0.2, 0.05), 0.3, turns=7.0),
    Drawn("two of 16 belong elsewhere", 16, (0.3, 0.03), 0.3, outliers=2),
    Drawn("target 1 % larger, 18", 18, (0.2, 0.03), 0.3, in_hand=True, size=1.01),
    Drawn("focal length 1 % off, 16", 16, (0.5, 0.05), 0.3, focal=1.01),
    Drawn("one small tag, 14", 14, (0.2, 0.03), 0.2, corners=(2, 2, 60.0)),
    Drawn("pairs, 20", 20, (0.5, 0.05), pairs=(1.0, 0.3)),
    Drawn("pairs in the hand, 10", 10, (0.05, 0.3), pairs=(0.3, 0.1), in_hand=True),
    Drawn("pairs, one of 12 elsewhere", 12, (0.3, 0.05), pairs=(0.5, 0.1), outliers=1),
)


def draws(kind: Drawn, seed: int) -> list[Recorded]:
    """As many recordings of a kind as are judged."""
    return [draw(kind, seed + number) for number in range(-(-JUDGED // kind.count))]


@dataclass(frozen=True)
class Truth:
    """flange, seen: (n, 4, 4) base_from_wrist and camera_from_target as they were."""

    flange: Array
    seen: Array


def draw(kind: Drawn, seed: int) -> Recorded:
    """One recording of a kind."""
    return draw_with_truth(kind, seed)[0]


def draw_with_truth(kind: Drawn, seed: int) -> tuple[Recorded, Truth]:
    """One recording of a kind, and what it was drawn from."""
    rng = np.random.default_rng(seed)
    columns, rows, pitch = kind.corners
    board = np.array([(pitch * x, pitch * y, 0.0) for y in range(rows) for x in range(columns)])
    held = matrix(Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 120, 3))
    fixed = matrix(Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 900, 3))
    K = np.array([[1180.0, 0, 655], [0, 1184.0, 470], [0, 0, 1]])
    flange, told, views = [], [], []
    for _ in range(kind.count):
        tilt = Rotation.from_rotvec(np.radians(kind.turns) * rng.normal(size=3)).as_matrix()
        middle = np.array([*rng.uniform(-70, 70, 2), rng.uniform(*kind.away_mm)])
        seen = matrix(tilt, middle - tilt @ board.mean(axis=0))
        # eye-to-hand: fixed is the camera in the base; in the hand: held is the camera in the wrist
        true = (
            fixed @ np.linalg.inv(held @ seen)
            if kind.in_hand
            else fixed @ seen @ np.linalg.inv(held)
        )
        flange.append(true)
        told.append(_shaken(true, *kind.arm, rng))
        views.append(seen)
    for index in rng.choice(kind.count, kind.outliers, replace=False):
        told[index] = _shaken(told[index], *ELSEWHERE, rng)
    truth = Truth(np.array(flange), np.array(views))
    if kind.pairs is not None:
        poses = np.array([_shaken(seen, *kind.pairs, rng) for seen in views])
        return Recorded(kind.name, kind.in_hand, np.array(told), seen=poses), truth
    pixels = tuple(_pictured(board * kind.size, seen, K, kind.px, rng) for seen in views)
    stated = K * np.array([[kind.focal], [kind.focal], [1.0]])
    stated[:2, 2] = K[:2, 2]
    points = (board,) * kind.count
    recorded = Recorded(
        kind.name, kind.in_hand, np.array(told), stated, np.zeros(5), points, pixels
    )
    return recorded, truth


def elsewhere(recorded: Recorded, indices: Sequence[int], seed: int) -> Recorded:
    """The recording with some flange poses of another moment."""
    rng = np.random.default_rng(seed)
    flange = recorded.flange.copy()
    for index in indices:
        flange[index] = _shaken(flange[index], *ELSEWHERE, rng)
    return replace(recorded, flange=flange)


def _shaken(pose: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """The pose moved in its own frame."""
    turn = Rotation.from_rotvec(np.radians(deg) * rng.normal(size=3)).as_matrix()
    return pose @ matrix(turn, mm * rng.normal(size=3))


def _pictured(points: Array, seen: Array, K: Array, px: float, rng: np.random.Generator) -> Array:
    turn, shift = cv2.Rodrigues(seen[:3, :3])[0], seen[:3, 3]
    exact = cv2.projectPoints(points, turn, shift, K, np.zeros(5))[0].reshape(-1, 2)
    return np.asarray(exact + px * rng.normal(size=exact.shape))
