"""Hand-eye on recordings, each sample predicted without itself: ours over the best single method, and set by set."""

from collections.abc import Iterator

import numpy as np

from tests.benchmarks.hand_eye.judge import FIGURES, Judged, judged, recordings
from tests.benchmarks.hand_eye.peers import METHODS
from tests.benchmarks.harness import Row

SINGLE_BAR = 1.0  # geometric mean over the recordings, of the best single method
SET_BAR = 1.05  # each recording, or one paired bootstrap standard error


def rows() -> Iterator[Row]:
    """hand_eye_FIGURE_vs_single, and hand_eye_FIGURE_worst: misses of the bar of a set, in its allowance."""
    all_judged = [judged(recorded) for recorded in recordings()]
    for figure in FIGURES:
        yield _single(figure, all_judged)
        yield _worst(figure, all_judged)


def _single(figure: str, all_judged: list[Judged]) -> Row:
    of = FIGURES[figure]
    means = {
        name: float(
            np.exp(
                np.mean([np.log(of(j.misses["vgrd"]) / of(j.misses[name])) for j in all_judged])
            )
        )
        for name in METHODS
    }
    best = max(means, key=lambda name: means[name])
    note = f"{len(all_judged)} recordings, leave-one-out, best single: {best}"
    return Row.at_most(f"hand_eye_{figure}_vs_single", means[best], "ratio", SINGLE_BAR, note)


def _worst(figure: str, all_judged: list[Judged]) -> Row:
    excesses = {}
    for one in all_judged:
        ratio, spread, best = one.ratio(figure)
        excesses[f"{one.name}: {ratio:.3f} +- {spread:.3f} of {best}"] = (ratio - 1) / max(
            SET_BAR - 1, spread
        )
    worst = max(excesses, key=lambda name: excesses[name])
    return Row.at_most(f"hand_eye_{figure}_worst", excesses[worst], "allowances", 1.0, worst)
