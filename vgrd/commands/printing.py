"""What commands print: tables for people, JSON for programs, a progress bar while it takes long."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vgrd.errors import InputError

if TYPE_CHECKING:  # rich would make `vgrd --help` a third slower
    from rich.console import Console, RenderableType
    from rich.table import Table


def _json_target(json_to: str | None) -> str | None:
    """Refuse a file that cannot be written before the work is done, not after it."""
    if json_to not in (None, "-"):
        path = Path(json_to)
        if not path.parent.is_dir():
            raise InputError(f"--json {json_to}: there is no folder {path.parent}; make it first")
        if path.is_dir():
            raise InputError(f"--json {json_to}: is a folder; name a file in it")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise InputError(f"--json {json_to}: may not be written; choose another place")
    return json_to


JsonOption = Annotated[
    str | None,
    typer.Option(
        "--json", help="Write the result as JSON to FILE, - is the output.", callback=_json_target
    ),
]

Result = Mapping[str, Any]


class Terminal:
    """Shows text and tables to people; rich is loaded for the first of them."""

    @cached_property
    def _console(self) -> "Console":
        from rich.console import Console

        return Console()

    def print(
        self,
        content: "RenderableType",
        *,
        highlight: bool | None = None,
        markup: bool | None = None,
    ) -> None:
        """Print it to standard output, as wide as the terminal."""
        self._console.print(content, highlight=highlight, markup=markup)


console = Terminal()


def print_result(result: Result, json_to: str | None, show: Callable[[Result], None]) -> None:
    """Write JSON where asked; otherwise (and beside a file) show it for people."""
    if json_to is not None:
        import json

        text = json.dumps(result, indent=2, allow_nan=False)
        if json_to == "-":
            print(text)
            return
        try:
            Path(json_to).write_text(text + "\n", encoding="utf-8")
        except OSError as err:
            raise InputError(f"--json {json_to}: cannot be written: {err.strerror}") from err
    show(result)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> "Table":
    """Table for people."""
    from rich.table import Table

    out = Table(*columns, title=title, title_justify="left")
    for row in rows:
        out.add_row(*(_cell(value) for value in row))
    return out


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, list | tuple):
        return ", ".join(_cell(item) for item in value)
    return "-" if value is None else str(value)


_DRAWN = frozenset({"scenery", "verifications"})  # for drawings and tables of a page


def show_fields(title: str) -> Callable[[Result], None]:
    """How to print a result as a table of its fields."""

    def show(result: Result) -> None:
        console.print(table(title, ("what", "value"), list(flat(result))))

    return show


def flat(result: Result, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Fields by dotted names, findings by their codes."""
    for key, value in result.items():
        if key in _DRAWN:
            continue
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        elif key == "findings":
            yield from ((f"finding: {item['code']}", item["message"]) for item in value)
        else:
            yield f"{prefix}{key}", value


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Say on standard error what takes a while, as long as it does."""
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error; yields `report(done, total)`."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
