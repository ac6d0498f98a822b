"""Clean sessions: cells that are as their file says, many of them: false alarms of all tests together."""

from dataclasses import replace

from fakes.studies.misfits import study as misfits
from fakes.studies.misfits.worlds import ROWS

STUDY = replace(
    misfits.STUDY,
    name="clean-sessions",
    title="Cells that are as their file says",
    cases=tuple({"world": name} for name, row in ROWS.items() if not row.causes),
    runs=100,
    full_runs=2000,
)
