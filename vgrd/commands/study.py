"""The door to the studies, which live on the simulated cell, outside the daemon."""

import runpy
import sys

import typer

_MODULE = "fakes.studies"  # named, not imported: the daemon knows no fake


def register(app: typer.Typer) -> None:
    """Add study."""
    app.command(
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )(study)


def study(context: typer.Context) -> None:
    """Repeat a simulation or experiment of the paper, or one of ours: vgrd study --help."""
    sys.argv[1:] = context.args
    runpy.run_module(_MODULE, run_name="__main__")
