"""Does the 95 % figure of a recording hold? Recordings are drawn, solved, and asked about further looks.

`python -m tests.benchmarks coverage`: a row per case, the share of further looks (as noisy as the samples, one
in ten of another moment where as many samples are) that lie within `quality.within_mm` and `within_deg`, and of
true flange poses whose target is within `calibration_mm`. The estimator begins with 0.5 mm and 1 mrad of every arm;
the cases go from a tenth to ten times of it. `VGRD_BENCH_SHARE=1` draws all trials, else a fifth of them.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.benchmarks.hand_eye.drawn import Drawn, Truth, draw_with_truth, elsewhere
from tests.benchmarks.hand_eye.judge import off, written
from tests.benchmarks.hand_eye.recordings import Array, Recorded
from tests.benchmarks.harness import Row
from vgrd.solving.datasets import DatasetSolution, solve_dataset

SEED = 5000
FURTHER = 20  # looks after the samples
SHARE = float(os.environ.get("VGRD_BENCH_SHARE", "0.2"))
TRIALS: Mapping[int, int] = {8: 100, 15: 60, 40: 20}  # by the number of samples
LOWEST, HIGHEST = 92.0, 99.0  # %
GIVEN_AWAY = 2.0  # standard errors of the share among the trials that a bar gives away
CASES: Mapping[str, Drawn] = {  # outliers: one in so many
    "arm 0.1 x assumed": Drawn("", 0, (0.05, 0.006), 0.2),
    "arm 0.5 x assumed": Drawn("", 0, (0.25, 0.03), 0.3, in_hand=True),
    "arm 2 x assumed": Drawn("", 0, (1.0, 0.12), 0.3),
    "arm 12 x assumed": Drawn("", 0, (6.0, 0.3), 1.0, in_hand=True),
    "pixels 2": Drawn("", 0, (0.1, 0.01), 2.0),
    "one in ten elsewhere": Drawn("", 0, (0.3, 0.03), 0.3, outliers=10),
    "pairs": Drawn("", 0, (0.5, 0.05), pairs=(1.0, 0.3)),
    "fine pairs": Drawn("", 0, (0.1, 0.02), pairs=(0.2, 0.05), in_hand=True),
    "pairs, one in ten elsewhere": Drawn("", 0, (0.5, 0.05), pairs=(1.0, 0.3), outliers=10),
}


def rows() -> Iterator[Row]:
    """hand_eye_within_N_CASE of every case and number of samples: the lowest of mm and deg, and the highest."""
    for count, trials in TRIALS.items():
        for name, kind in CASES.items():
            runs = max(4, round(SHARE * trials))
            shares = np.array([covered(kind, count, SEED + seed) for seed in range(runs)])
            yield from _judged(f"hand_eye_within_{count}_{name}", shares)


def _judged(name: str, shares: Array) -> Iterator[Row]:
    mean = shares.mean(axis=0)
    fair = 100 * np.sqrt(0.95 * 0.05 / (FURTHER * len(shares)))  # of as many looks, each by itself
    error = np.maximum(shares.std(axis=0) / np.sqrt(len(shares)), fair)
    told = ", ".join(
        f"{what} {m:.1f} +- {e:.1f}"
        for what, m, e in zip(("mm", "deg", "calibration"), mean, error, strict=True)
    )
    low, high = mean + GIVEN_AWAY * error, mean - GIVEN_AWAY * error
    yield Row.at_least(
        f"{name}, least", float(low[:2].min()), "%", LOWEST, f"{len(shares)}: {told}"
    )
    yield Row.at_most(f"{name}, most", float(high[:2].max()), "%", HIGHEST)


def covered(kind: Drawn, count: int, seed: int) -> Array:
    """(3,) percent of further looks within the mm and the deg told, of true poses within the calibration's mm."""
    recorded, truth = draw_with_truth(replace(kind, count=count + FURTHER, outliers=0), seed)
    if kind.outliers:
        some = max(1, round(count / kind.outliers))
        late = range(count, count + FURTHER // kind.outliers)
        recorded = elsewhere(recorded, [*range(some), *late], seed)
    with tempfile.TemporaryDirectory() as folder:
        solution = solve_dataset(written(first(recorded, count), Path(folder)))
    assert isinstance(solution, DatasetSolution)
    further = range(count, count + FURTHER)
    return 100 * np.mean([_within(recorded, truth, solution, i) for i in further], axis=0)


def _within(recorded: Recorded, truth: Truth, solution: DatasetSolution, index: int) -> list[bool]:
    quality, camera = solution.quality, solution.camera
    assert quality is not None
    X, Y = solution.mount_from_camera.matrix(), solution.mount_from_target.matrix()
    told, true = (
        np.linalg.inv(X) @ (np.linalg.inv(H) if recorded.in_hand else H) @ Y
        for H in (recorded.flange[index], truth.flange[index])
    )
    K, distortion = recorded.K, recorded.distortion
    if camera is not None and solution.refined:
        K, distortion = camera.matrix, camera.distortion
    deg, mm, _ = off(recorded, index, told, K, distortion)
    miss = float(np.linalg.norm(true[:3, 3] - truth.seen[index][:3, 3]))
    return [mm <= quality.mm, deg <= quality.deg, miss <= quality.calibration_mm]


def first(recorded: Recorded, count: int) -> Recorded:
    """The first samples of a recording."""
    return replace(
        recorded,
        flange=recorded.flange[:count],
        points=recorded.points[:count],
        pixels=recorded.pixels[:count],
        seen=None if recorded.seen is None else recorded.seen[:count],
    )
