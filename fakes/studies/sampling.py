"""What chance alone leaves open where something is repeated as few times as the paper repeated it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fakes.studies.study import Figure
from vgrd.geometry import Array

_SEED = 95  # any: so that a study prints the same again
_EXPERIMENTS = 2000  # imagined ones: tell the edges of 95 % to a tenth of their width
Statistic = Callable[[Array], float]


def interval95(values: Array) -> tuple[float, float]:
    """The middle 95 % of values (n,), those that are no numbers left out; NaN without any."""
    known = values[np.isfinite(values)]
    if not known.size:
        return float("nan"), float("nan")
    low, high = np.percentile(known, (2.5, 97.5))
    return float(low), float(high)


def resampled(rows: Array, repetitions: int, statistic: Statistic) -> Array:
    """The statistic of experiments of `repetitions` rows each, drawn from rows (n, ...) with replacement."""
    if not len(rows):
        return np.array([float("nan")])
    rng = np.random.default_rng(_SEED)
    return np.array(
        [statistic(rows[rng.integers(len(rows), size=repetitions)]) for _ in range(_EXPERIMENTS)]
    )


def ratio_of_means(rows: Array) -> float:
    """Mean of the second column of rows (n, 2) over that of the first."""
    first, second = rows.mean(axis=0)
    return float(second / first)


def beside_the_paper(
    figure: Figure, experiments: Array, low: float, high: float | None = None
) -> Figure:
    """The figure with the 95 % interval of experiments as small as the paper's, (n,) values of them.

    low, high: the paper's statement; None: it is one number.
    """
    published = (low, low if high is None else high)
    return replace(figure, interval=interval95(experiments), published=published)
