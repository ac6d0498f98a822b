"""Runs the benchmarks: `python -m tests.benchmarks [NAME ...]`.

Every module bench_*.py in the rooms of this folder has `rows()`, which returns or yields rows. Each runs in
a process of its own and shows its rows as they come; build/bench.json is written with every row. Exit code 1
when a bar is not cleared or a module failed.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.benchmarks.harness import Row
from tests.benchmarks.measuring import measure

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
TIMEOUT_S = (
    1800.0  # the slowest row takes minutes; with all pictures (VGRD_BENCH_SHARE=1) give more
)


def chosen(folder: Path, names: Sequence[str]) -> list[Path]:
    """The modules of a folder and its rooms whose file name holds one of `names`; all without names."""
    paths = sorted(folder.rglob("bench_*.py"), key=lambda path: path.stem)
    return [path for path in paths if not names or any(name in path.stem for name in names)]


def rows_of(paths: Iterable[Path], timeout_s: float, console: Console) -> Iterable[Row]:
    """Rows of modules one after the other; says which one runs."""
    for path in paths:
        console.print(f"{path.stem} ...", style="dim")
        yield from measure(name_of(path), str(path.parent), timeout_s)


def name_of(path: Path) -> str:
    """Dotted name of one of our modules; the bare one of a module of elsewhere."""
    ours = path.is_relative_to(HERE)
    return ".".join(path.relative_to(ROOT).with_suffix("").parts) if ours else path.stem


def table_of(rows: Sequence[Row]) -> Table:
    """The table of all rows."""
    table = Table("benchmark", "value", "bar", "unit", "", "measured")
    table.columns[0].no_wrap = True
    for column in (1, 2):
        table.columns[column].justify = "right"
    for row in rows:
        table.add_row(*cells_of(row))
    return table


def cells_of(row: Row) -> tuple[str, ...]:
    """What the table shows of a row."""
    if row.failure:
        return row.name, "", "", "", "FAILED", row.failure
    if row.skip:
        return row.name, "", "", "", "skipped", row.skip
    value, bar = f"{row.value:.3g}", f"{row.relation} {row.bar:g}"
    return row.name, value, bar, row.unit, "ok" if row.ok else "MISSED", row.note


def write(rows: Sequence[Row], result: Path) -> None:
    """Write all rows so far; a run that is cut short keeps them."""
    result.parent.mkdir(parents=True, exist_ok=True)
    fresh = result.with_suffix(".part")
    fresh.write_text(json.dumps([row.as_json() for row in rows], indent=2) + "\n")
    fresh.replace(result)


def main() -> int:
    """Measure, show, write; 0 when all bars are cleared."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks")
    parser.add_argument("names", nargs="*", help="parts of module names; all when none is given")
    parser.add_argument("--folder", type=Path, default=HERE, help="where the modules are")
    parser.add_argument("--result", type=Path, default=ROOT / "build" / "bench.json")
    parser.add_argument("--timeout-s", type=float, default=TIMEOUT_S, help="longest for one row")
    asked = parser.parse_args()
    console = Console()
    paths = chosen(asked.folder.resolve(), asked.names)
    if not paths:
        console.print(f"no benchmark is called {' or '.join(asked.names)}")
        return 2
    rows: list[Row] = []
    for row in rows_of(paths, asked.timeout_s, console):
        rows.append(row)
        write(rows, asked.result)
        line = "  ".join(filter(None, cells_of(row)))
        console.print(f"  {line}", style=None if row.ok else "red", markup=False, soft_wrap=True)
    console.print(table_of(rows))
    return 0 if all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
