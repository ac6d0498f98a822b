"""Writes docs/commands.md: `python -m tests.cli.checking.commands_page docs/commands.md`."""

import inspect
import os
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import click
import typer

from vgrd import errors
from vgrd.cli import app

INTRODUCTION = """\
# Commands

Generated from the commands themselves by `python -m tests.cli.checking.commands_page docs/commands.md`.

Commands that talk to a running daemon find it by `--config CELL.toml` or `--socket PATH`, or by the environment
variables VGRD_CONFIG and VGRD_SOCKET. `--json FILE` writes what is shown as JSON, `-` is the output.
"""
CODES = """\
## Exit codes

The same for every command, as in sysexits.h; a refusal of the daemon ends with the code of its reason.

| code | name | error | what happened |
| --- | --- | --- | --- |
| 0 | EX_OK | | nothing; warnings may have been told |"""
WRONG_WORDS = (2, "", "", "the arguments are not those of the command")  # click's own
WIDTH = 119  # of prose
EVERYWHERE = ("config", "socket", "json_to", "help")  # told once, in the introduction


def page() -> str:
    """The whole page."""
    root = typer.main.get_command(app)
    lines = [INTRODUCTION]
    for words, command in commands_of(root, ()):
        lines += section(words, command)
    lines += [CODES, *codes(), ""]
    return "\n".join(lines)


def commands_of(
    group: click.Command, words: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command that does something, with the words that call it."""
    children = getattr(group, "commands", None)
    if children is None:
        yield words, group
        return
    for name in sorted(children):
        yield from commands_of(children[name], (*words, name))


def section(words: tuple[str, ...], command: click.Command) -> Iterator[str]:
    """One command: what it is for, and its options."""
    parameters = [
        one
        for one in command.params
        if one.param_type_name == "argument" or one.name not in EVERYWHERE
    ]
    arguments = " ".join(
        metavar(one) if one.required else f"[{metavar(one)}]"
        for one in parameters
        if one.param_type_name == "argument"
    )
    yield f"## {' '.join(('vgrd', *words, arguments)).strip()}\n"
    yield f"{textwrap.fill(' '.join((command.help or '').split()), WIDTH)}\n"
    if parameters:
        yield "| | default | meaning |\n| --- | --- | --- |"
        yield from (row(parameter) for parameter in parameters)
        yield ""


def metavar(parameter: click.Parameter) -> str:
    """An argument as it is called in the help."""
    return getattr(parameter, "metavar", None) or (parameter.name or "").upper()


def row(parameter: click.Parameter) -> str:
    """A line of the table of options."""
    is_argument = parameter.param_type_name == "argument"
    word = metavar(parameter) if is_argument else ", ".join(parameter.opts)
    value, is_flag = parameter.default, getattr(parameter, "is_flag", False)
    default = "" if value is None or is_flag or callable(value) else f"`{value}`"
    needed = "required" if parameter.required else default
    meaning = " ".join((getattr(parameter, "help", "") or "").split()).replace("|", "or")
    return f"| `{word}` | {needed} | {meaning} |"


def codes() -> Iterator[str]:
    """A line for each error, by exit code."""
    names = {value: name for name, value in vars(os).items() if name.startswith("EX_")}
    rows = [
        (kind.exit_code, names.get(kind.exit_code, ""), name, first_sentence(kind))
        for name, kind in inspect.getmembers(errors, inspect.isclass)
        if issubclass(kind, errors.VgrdError)
    ]
    for line in sorted([*rows, WRONG_WORDS]):
        yield f"| {' | '.join(map(str, line))} |"


def first_sentence(kind: type) -> str:
    """What an error is, without its full stop."""
    return (inspect.getdoc(kind) or "").splitlines()[0].rstrip(".")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
