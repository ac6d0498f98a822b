"""Writes docs/checks.md from the findings: `python -m vgrd.judging.document docs/checks.md`."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from vgrd.judging.findings import BEFORE_SOLVING, OF_A_SESSION, OF_FILES, Kind

_INTRODUCTION = """\
# Findings

Generated from `vgrd/judging/findings.py` by `python -m vgrd.judging.document docs/checks.md`.

A finding has a stable code and a sentence with its figures and the remedy. A fatal finding refuses the result.
The thresholds stand, each once and with its reason, in `vgrd/judging/thresholds.py`.

A fatal mistake of conventions is told alone: what is wrong with the rest cannot be known before it is corrected.
No data can show a TCP or user frame that is active all the time: hand-eye, TCP and object take it up, and every
residual stays the same to the last digit. Nor can touches of points in one plane show that the plane is mirrored;
nothing depends on it.

How often all this is right: `vgrd study conventions` and `vgrd study degenerate` ([studies](studies.md)).
"""
_TABLES: Mapping[str, Mapping[str, Kind]] = {
    "Of a recording, before it is solved": BEFORE_SOLVING,
    "Of a session that was solved": OF_A_SESSION,
    "Of datasets and files of touches": OF_FILES,
}


def document() -> str:
    """The whole page."""
    return "\n".join([_INTRODUCTION, *_tables()])


def _tables() -> Iterator[str]:
    for title, kinds in _TABLES.items():
        yield f"## {title}\n"
        yield "| code | what it means | what to do | what tells it |\n| --- | --- | --- | --- |"
        for code, kind in kinds.items():
            remedy = kind.remedy or "what the sentence says"
            yield f"| `{code}` | {kind.meaning} | {remedy} | {kind.basis} |"
        yield ""


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
