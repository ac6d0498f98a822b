"""Whether pictures that no camera should send can crash or upset the tag finders.

Noise, stripes, extremes, degenerate quadrangles, warped and damaged tags, 12 MP, odd strides, 16 bit, and crops of
the photographs in the folder VGRD_PHOTOS, if there is one. A crash costs one picture; the next process goes on.
"""

import os
import subprocess
import sys
from collections.abc import Iterator

from tests.benchmarks.harness import Row, ending
from vgrd.orphans import dying_with_us

PICTURES = 10_000
MOST_FAILURES = 20  # then it is known well enough


def rows() -> Iterator[Row]:
    """finder_failures: pictures that crashed a finder or made it raise."""
    failures, first, searched = [], 0, 0
    while first < PICTURES and len(failures) < MOST_FAILURES:
        last, code, words = search(first)
        searched += last - first + 1
        first = last + 1
        if code:
            failures.append(f"picture {last} {ending(code)} {words}".strip())
    note = "; ".join([f"{searched} pictures", *failures])
    yield Row.at_most("finder_failures", len(failures), "", 0, note)


def search(first: int) -> tuple[int, int, str]:
    """Search from picture `first` on; the last number that was searched, the exit code, the last words."""
    argv = [sys.executable, "-m", "tests.benchmarks.hostile_pictures", str(PICTURES)]
    photos = os.environ.get("VGRD_PHOTOS")
    options = ["--first", str(first), *(["--photos", photos] if photos else [])]
    done = subprocess.run(
        dying_with_us([*argv, *options]), capture_output=True, text=True, check=False
    )
    numbers = done.stdout.split()
    last_words = done.stderr.strip().rpartition("\n")[2]
    return int(numbers[-1]) if numbers else first, done.returncode, last_words
