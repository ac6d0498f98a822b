"""The page as one file of HTML: no script, no font and no picture from elsewhere."""

import base64
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path

from fakes.studies.conducting import StudyOutcome
from fakes.studies.page.chapters import CHAPTERS, Chapter
from fakes.studies.page.markdown import html_of
from fakes.studies.study import Figure

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
h1,h2{line-height:1.2}h2{margin-top:3rem;border-bottom:1px solid #ccc}
table{border-collapse:collapse;font-size:.85rem;margin:1rem 0}
th,td{border-bottom:1px solid #ddd;padding:.2rem .6rem;text-align:left;vertical-align:top}
td.n{text-align:right;font-variant-numeric:tabular-nums}
code,pre{font:0.85em monospace;background:#f4f4f4}pre{padding:.5rem}
img{max-width:100%}.out{color:#a00}details{margin:1rem 0}
.wide{overflow-x:auto}
"""
_PAPER = "Efficient TCP Calibration Method for Vision Guided Robots Based on Inherent Constraints of Target Object"


def page(outcomes: Mapping[str, StudyOutcome], index: str) -> str:
    """The page. outcomes: of every chapter, by study; index: `docs/paper.md`."""
    return "\n".join(_lines(outcomes, index))


def _lines(outcomes: Mapping[str, StudyOutcome], index: str) -> Iterator[str]:
    yield "<!doctype html><html lang='en'><meta charset='utf-8'><title>The paper beside vgrd</title>"
    yield f"<style>{_STYLE}</style><h1>The paper beside vgrd</h1>"
    yield f"<p><i>{_PAPER}</i>: each figure and table of its data beside ours. The line above a table makes its"
    yield "numbers. <b>Paper</b> is what the paper prints. <b>95 % of its sample</b> is where a figure from as few"
    yield "repetitions as the paper made would lie by chance, and whether the paper's does.</p>"
    for heading, chapters in CHAPTERS:
        yield f"<h2>{escape(heading)}</h2>"
        for chapter in chapters:
            yield from _chapter(chapter, outcomes[chapter.study])
    yield "<h2>Index of equations</h2><details><summary>docs/paper.md</summary>"
    yield f"<div class='wide'>{html_of(index)}</div></details>"
    yield "</html>"


def _chapter(chapter: Chapter, outcome: StudyOutcome) -> Iterator[str]:
    yield f"<h3 id='{escape(chapter.study)}'>{escape(chapter.heading)}</h3><p>{escape(chapter.text)}</p>"
    command = f"vgrd study {outcome.name} --runs {outcome.runs} --seed {outcome.seed}"
    yield f"<pre>{escape(command)}</pre>"
    for file in outcome.files:
        if file.suffix == ".png":
            yield _picture(file, chapter.heading)
    yield _table(outcome.figures)


def _picture(file: Path, heading: str) -> str:
    data = base64.b64encode(file.read_bytes()).decode("ascii")
    return f"<img alt='{escape(heading, quote=True)}' src='data:image/png;base64,{data}'>"


def _table(figures: tuple[Figure, ...]) -> str:
    """Published figures first; all others folded away, so that nothing is left out."""
    beside = [figure for figure in figures if figure.paper]
    rest = [figure for figure in figures if not figure.paper]
    parts = [_rows(beside)] if beside else []
    if rest:
        count = f"{len(rest)} more figures" if beside else f"{len(rest)} figures"
        parts.append(f"<details><summary>{count}</summary>{_rows(rest)}</details>")
    return "".join(parts)


def _rows(figures: list[Figure]) -> str:
    head = ("figure", "vgrd", "unit", "paper", "95 % of its sample", "bar")
    rows = "".join(
        f"<tr><td>{escape(f.name)}<td class='n'>{f.value:.4g}<td>{escape(f.unit)}<td class='n'>{escape(f.paper)}"
        f"<td>{_sample(f)}<td>{escape(f.bar)}{'' if f.ok is not False else ' <b class=out>missed</b>'}"
        for f in figures
    )
    return f"<table><tr>{''.join(f'<th>{each}' for each in head)}{rows}</table>"


def _sample(figure: Figure) -> str:
    if figure.interval is None or figure.paper_inside is None:
        return ""
    low, high = figure.interval
    return f"{low:.3g} .. {high:.3g}: {'in' if figure.paper_inside else '<b class=out>out</b>'}"
