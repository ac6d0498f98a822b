"""The command that makes the password of the operator's page."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from vgrd.errors import InputError


def register(app: typer.Typer) -> None:
    """Add page-password."""
    app.command()(page_password)


def page_password(
    file: Annotated[Path, typer.Argument(help="To write: [page] password_file of the cell file.")],
) -> None:
    """Ask for the page's password, twice, and write its hash; without a terminal it is a line of the input.

    Run it as the daemon's user: nobody else can read the file.
    """
    from vgrd.page.access.password import Password

    Password.made_of(_asked()).save(file)
    typer.echo(
        f"{file}: written; it counts from the next log-in on, which ends what was begun with an older one"
    )


def _asked() -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    word = str(typer.prompt("password", hide_input=True))
    if word != typer.prompt("again", hide_input=True):
        raise InputError("the two are not the same: nothing was written")
    return word
