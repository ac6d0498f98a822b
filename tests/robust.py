"""The numerical half of the suite as other machines would round it: `python -m tests.robust`.

Two perturbations of all of it, then its delicate part under every kernel of OpenBLAS that runs here,
then the finding of boards as code for any processor. Arguments go to pytest. Ends with 1 when a test
failed, after all runs; what is not run is named.
"""

import os
import subprocess
import sys
from typing import NamedTuple

from rich.console import Console

from tests.kernels import kernels

DELICATE = ("tests/calibration", "tests/touch_files")
ALL = (*DELICATE, "tests/geometry", "tests/datasets", "tests/studies")
COMPILED = ("tests/datasets/test_boards.py",)  # what numba compiles serves pictures only
SEEDS = (1, 2)
PLAIN = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class Run(NamedTuple):
    """One run of pytest."""

    name: str
    arguments: tuple[str, ...]
    environment: dict[str, str]


def planned(console: Console) -> list[Run]:
    """All runs; tells which kernels are not among them and why."""
    runs = [Run(f"perturbation {seed}", ("--perturb", str(seed), *ALL), {}) for seed in SEEDS]
    for kernel in kernels():
        if kernel.refused:
            console.print(f"not run: kernel {kernel.name}: {kernel.refused}")
        else:
            runs.append(Run(f"kernel {kernel.name}", DELICATE, kernel.environment))
    runs.append(Run("numba generic", COMPILED, {"NUMBA_CPU_NAME": "generic"}))
    console.print("not run: numba host: that is `make test`")
    return runs


def main(arguments: list[str]) -> int:
    """Run all, tell all; 1 when one failed."""
    console = Console()
    failed = []
    for name, chosen, environment in planned(console):
        console.rule(name)
        argv = [sys.executable, "-m", "pytest", "-q", "-m", "not system", *arguments, *chosen]
        if subprocess.run(argv, env=os.environ | PLAIN | environment, check=False).returncode:
            failed.append(name)
    console.rule()
    console.print(
        f"failed: {', '.join(failed)}" if failed else "no test passes by luck of rounding"
    )
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
