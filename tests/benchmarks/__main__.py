"""Runs the benchmarks: `python -m tests.benchmarks [NAME ...]`.

Every module bench_*.py in this folder has `rows() -> list[Row]`. Prints a table, writes
build/bench.json, ends with exit code 1 when a bar is not cleared.
"""

import importlib
import json
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.benchmarks.harness import Row

HERE = Path(__file__).parent
RESULT = HERE.parents[1] / "build" / "bench.json"


def measure(names: list[str], console: Console) -> list[Row]:
    """Rows of all benchmark modules, or of those whose file name holds one of `names`."""
    rows: list[Row] = []
    for path in sorted(HERE.glob("bench_*.py")):
        if names and not any(name in path.stem for name in names):
            continue
        with console.status(path.stem):
            rows += importlib.import_module(f"tests.benchmarks.{path.stem}").rows()
    return rows


def show(rows: list[Row], console: Console) -> None:
    """Print the table."""
    table = Table("benchmark", "value", "bar", "unit", "", "measured")
    table.columns[0].no_wrap = True
    for column in (1, 2):
        table.columns[column].justify = "right"
    for row in rows:
        value, bar = f"{row.value:.3g}", f"{row.relation} {row.bar:g}"
        table.add_row(row.name, value, bar, row.unit, "ok" if row.ok else "MISSED", row.note)
    console.print(table)


def main(names: list[str]) -> int:
    """Measure, show, write; 0 when all bars are cleared."""
    console = Console()
    rows = measure(names, console)
    if not rows:
        console.print(f"no benchmark is called {' or '.join(names)}")
        return 2
    show(rows, console)
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps([row.as_json() for row in rows], indent=2) + "\n")
    return 0 if all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
