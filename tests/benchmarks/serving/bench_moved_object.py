"""The longest time for which a wrong coordinate was valid, by what happened to the camera.

`python -m tests.benchmarks.moved_object --trials 500` makes as many trials as docs/registers.md cites.
"""

from collections.abc import Iterator

from tests.benchmarks.harness import Row
from tests.benchmarks.moved_object import CAMERAS, trials

TRIALS = 25
WORKING_MS = 400.0  # watch period + latency of a region + 0.1 s
LOST_MS = 260.0  # four missed beats and the registers' own 40 ms
SILENT_MS = 200.0  # watch period + 0.1 s
BARS_MS = {
    "working": WORKING_MS,
    "killed": LOST_MS,
    "stopped": LOST_MS,
    "frozen": SILENT_MS,
    "unplugged": SILENT_MS,
}


def rows() -> Iterator[Row]:
    """moved_object_*: ms, longest of the trials."""
    for camera in CAMERAS:
        done = list(trials(camera, TRIALS, seed=1))
        longest_ms = 1e3 * max(each.wrong_s for each in done)
        note = f"{TRIALS} trials, worst miss {max(each.worst_mm for each in done):.1f} mm"
        yield Row.at_most(f"moved_object_{camera}", longest_ms, "ms", BARS_MS[camera], note)
