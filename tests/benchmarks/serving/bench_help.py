"""What the shortest command costs: `vgrd --help` against the library alone that reads its arguments."""

import resource
import subprocess
import sys

from tests.benchmarks.harness import Row, ratio_of

HELP = ("-m", "vgrd.cli", "--help")
TYPER = ("-c", "import typer")
ROUNDS = 15
BAR = 1.6


def cpu_s(*words: str) -> float:
    """Seconds of CPU, user and system, of one run of the interpreter with these words."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def rows() -> list[Row]:
    """help_vs_import_typer: CPU of `vgrd --help` over that of `python -c "import typer"`."""
    ratio, ours, library = ratio_of(lambda: cpu_s(*HELP), lambda: cpu_s(*TYPER), ROUNDS)
    note = f"{1000 * ours:.0f} ms, import typer {1000 * library:.0f} ms of CPU"
    return [Row.at_most("help_vs_import_typer", ratio, "x", BAR, note)]
