"""The command that writes a DATASET.toml from whatever a user has."""

from pathlib import Path
from typing import Annotated

import typer

from vgrd.commands.printing import JsonOption, Result, console, print_result
from vgrd.errors import InputError


def register(app: typer.Typer) -> None:
    """Add import."""
    app.command(name="import")(import_)


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Tables of poses, pictures or folders of them, a camera file, a board file.",
        ),
    ],
    meant: Annotated[
        list[str] | None,
        typer.Option(
            "--as",
            metavar="KEY=VALUE",
            help="What is meant: mount, rotation, unit, camera_rotation, camera_unit, camera_name; "
            "may be repeated.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="The dataset to write.")] = Path("dataset.toml"),
    json_to: JsonOption = None,
) -> None:
    """Write a dataset from recordings in other forms, and tell all that was assumed."""
    from vgrd.importing import import_files

    if out.exists():
        raise InputError(f"--out {out}: is there already; name another file, or remove it")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")
    said = dict(_pair(word) for word in meant or ())
    imported = import_files(files, said, out.parent)
    try:
        out.write_text(imported.text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from error
    result = {
        "file": str(out),
        "samples": imported.count,
        "kind": imported.kind,
        "assumed": list(imported.told),
        "next": f"vgrd solve {out}",
    }
    print_result(result, json_to, _show)


def _pair(word: str) -> tuple[str, str]:
    key, equals, value = word.partition("=")
    if not equals:
        raise InputError(f"--as {word}: write KEY=VALUE, such as mount=eye-in-hand")
    return key.strip(), value.strip()


def _show(result: Result) -> None:
    for sentence in result["assumed"]:
        console.print(f"  {sentence}", highlight=False, markup=False)
    console.print(
        f"{result['file']}: {result['samples']} samples; next: {result['next']}",
        highlight=False,
        markup=False,
    )
