"""docs/commands.md: every command is on it, as the command line has it."""

from pathlib import Path

import typer

from tests.cli.checking.commands_page import commands_of, page
from vgrd.cli import app

PAGE = Path(__file__).parents[3] / "docs" / "commands.md"


def test_the_page_of_the_commands_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), (
        "run: python -m tests.cli.checking.commands_page docs/commands.md"
    )


def test_every_command_and_option_says_what_it_is_for() -> None:
    silent = []
    for words, command in commands_of(typer.main.get_command(app), ()):
        options = [one for one in command.params if one.param_type_name == "option"]
        silent += [" ".join(words)] if not command.help else []
        silent += [f"{' '.join(words)} {one.name}" for one in options if not one.help]
    assert not silent
