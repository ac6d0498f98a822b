"""As much of Markdown as the index of the paper uses: headings, paragraphs, tables, code, links, bold and slanted."""

import re
from collections.abc import Iterator
from html import escape
from itertools import groupby

_CODE = re.compile(r"`([^`]+)`")
_LINK = re.compile(
    r"\[([^\]]+)\]\([^)]+\)"
)  # their targets are files beside it, which the page has not
_BOLD = re.compile(r"\*\*([^*]+)\*\*")
_SLANTED = re.compile(r"\*([^*]+)\*")


def html_of(markdown: str) -> str:
    """HTML of a document; what is not known is text."""
    return "\n".join(_blocks(markdown))


def _blocks(markdown: str) -> Iterator[str]:
    for kind, lines in groupby(markdown.splitlines(), _kind):
        if kind == "heading":
            yield from (_heading(line) for line in lines)
        elif kind == "table":
            yield _table(list(lines))
        elif kind == "text":
            yield f"<p>{_inline(' '.join(lines))}</p>"


def _kind(line: str) -> str:
    if not line.strip():
        return "empty"
    return {"#": "heading", "|": "table"}.get(line[0], "text")


def _heading(line: str) -> str:
    level = min(len(line) - len(line.lstrip("#")) + 2, 6)  # below the page's own
    return f"<h{level}>{_inline(line.lstrip('# '))}</h{level}>"


def _table(lines: list[str]) -> str:
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    head, body = rows[0], [row for row in rows[1:] if set("".join(row)) - set("-: ")]
    cells = "".join(f"<th>{_inline(cell)}" for cell in head)
    return f"<table><tr>{cells}" + "".join(_row(row) for row in body) + "</table>"


def _row(cells: list[str]) -> str:
    return "<tr>" + "".join(f"<td>{_inline(cell)}" for cell in cells)


def _inline(text: str) -> str:
    """Code first: nothing in it is marked."""
    parts = _CODE.split(text)
    return "".join(
        f"<code>{escape(part)}</code>" if i % 2 else _marked(escape(part, quote=False))
        for i, part in enumerate(parts)
    )


def _marked(text: str) -> str:
    text = _LINK.sub(r"\1", text)
    return _SLANTED.sub(r"<i>\1</i>", _BOLD.sub(r"<b>\1</b>", text))
