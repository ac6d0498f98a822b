"""`python -m tests.invariant`: the walk of CI, or a day of it (`make soak`); exit code 1 where something is wrong."""

import argparse
import sys
import time
from collections.abc import Sequence

from tests.invariant.reading.judge import Lie
from tests.invariant.simulation.teaching import VARIANTS
from tests.invariant.soak import HOURS, READS, Growth, soak

SEED = 7


def main(argv: Sequence[str] | None = None) -> int:
    """Tell how it goes; with a lie, what happened before it."""
    parser = argparse.ArgumentParser(prog="python -m tests.invariant", description=__doc__)
    parser.add_argument("--hours", type=float, default=HOURS, help="of the simulated cell")
    parser.add_argument("--reads", type=int, default=READS)
    parser.add_argument("--seed", type=int, default=SEED, help="another walk")
    parser.add_argument("--first", type=int, default=1, help="variant of twelve to begin with")
    given = parser.parse_args(argv)
    start_s = time.monotonic()

    def tell(words: str) -> None:
        print(f"[{time.monotonic() - start_s:6.0f} s] {words}", flush=True)

    try:
        total = soak(given.hours, given.reads, given.seed, tell, VARIANTS[given.first - 1 :])
    except (Lie, Growth) as err:
        tell("\n".join([str(err), *getattr(err, "__notes__", [])]))
        return 1
    tell(f"no lie, nothing grew\n{total.summary()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
