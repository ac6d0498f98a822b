"""The command that writes a page about a session."""

from pathlib import Path
from typing import Annotated

import typer

from vgrd.commands.asking import ConfigOption, SocketOption, ask
from vgrd.commands.printing import console
from vgrd.errors import InputError

_REPORT_S = 60.0  # a report reads one picture; beyond it something hangs


def register(app: typer.Typer) -> None:
    """Add report."""
    app.command()(report)


def report(
    session: Annotated[
        str | None,
        typer.Argument(
            help="A session folder, or the name of one that the daemon keeps; none: the newest that was solved."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; none: report-SESSION.html here.")
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
) -> None:
    """Write one page to print: verdict, error budget, noise, verifications, picture, hashes."""
    if session is not None and Path(session).is_dir():
        name, page = Path(session).resolve().name, _page_of(Path(session).resolve())
    else:
        told = ask(
            config, socket, "report", _REPORT_S, **({"session": session} if session else {})
        )
        name, page = str(told["session"]), str(told["html"])
    file = out or Path(f"report-{name}.html")
    try:
        file.write_text(page, encoding="utf-8")
    except OSError as err:
        raise InputError(f"--out {file}: cannot be written: {err.strerror}") from err
    console.print(
        f"{file}: open it in a browser, and print it there", highlight=False, markup=False
    )


def _page_of(folder: Path) -> str:
    """Of a folder without a daemon; what was not solved yet is solved for it, and not kept."""
    from vgrd.reporting import report_of, report_page
    from vgrd.solving.session import solve_session
    from vgrd.store.results import read_result

    result = read_result(folder) or solve_session(folder)
    is_kept = folder.parent.name == "sessions"
    return report_page(report_of(folder, folder.parent.parent if is_kept else None, result))
