"""The benchmarks run, print a table and leave their figures; what they measure is not judged here."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_a_benchmark_leaves_its_figures() -> None:
    command = [sys.executable, "-m", "tests.benchmarks", "ring"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    assert "ring_image_vs_memcpy" in done.stdout
    rows = json.loads((ROOT / "build" / "bench.json").read_text(encoding="utf-8"))
    assert [set(row) for row in rows] == [{"name", "value", "unit", "bar", "ok"}]
