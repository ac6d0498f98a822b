"""Hand-eye on recordings, each sample predicted without itself: ours over the best single method, and set by set."""

from collections.abc import Iterator

from tests.benchmarks.hand_eye.judge import (
    FIGURES,
    GIVEN,
    OURS,
    SET_BAR,
    Judged,
    judged,
    recordings,
    single,
)
from tests.benchmarks.harness import Row

SINGLE_BAR = 1.0  # geometric mean over the recordings, of the best single method


def rows() -> Iterator[Row]:
    """hand_eye_FIGURE_vs_single, and hand_eye_FIGURE_worst: misses of the bar of a set, in its allowance."""
    all_judged = [judged(alike) for alike in recordings()]
    for figure in FIGURES:
        yield _single(figure, all_judged)
        yield _worst(figure, all_judged)


def _single(figure: str, all_judged: list[Judged]) -> Row:
    mean, best = single(figure, all_judged)
    note = f"{len(all_judged)} recordings, leave-one-out, best single: {best}"
    return Row.at_most(f"hand_eye_{figure}_vs_single", mean, "ratio", SINGLE_BAR, note)


def _worst(figure: str, all_judged: list[Judged]) -> Row:
    excesses = {}
    for one in all_judged:
        for ours in (OURS, GIVEN):
            ratio, spread, best = one.ratio(figure, ours)
            told = f"{one.name}, {ours}: {ratio:.3f} +- {spread:.3f} of {best}"
            excesses[told] = (ratio - 1) / max(SET_BAR - 1, spread)
    worst = max(excesses, key=lambda name: excesses[name])
    return Row.at_most(f"hand_eye_{figure}_worst", excesses[worst], "allowances", 1.0, worst)
