"""A study whose trials never end; each tells the process that it runs in."""

import os
import signal
import sys

from fakes.studies.runner import run_trials
from fakes.studies.study import Study
from vgrd.charts import panels


def _wait(seed, parameters):
    sys.stdout.write(f"{os.getpid()}\n")
    sys.stdout.flush()
    signal.pause()


ENDLESS = Study(
    name="endless",
    title="Endless",
    cases=({},),
    runs=2,
    trial=_wait,
    figures=lambda _: [],
    draw=lambda _: panels("", ("x", "y"))[0],
)

if __name__ == "__main__":
    run_trials(ENDLESS, 2, 0, workers=2)
