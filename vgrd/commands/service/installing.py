"""Commands that put vgrd onto this machine as a service, and take it off."""

import typer

_RAW = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}


def register(app: typer.Typer) -> None:
    """Add install and uninstall."""
    for command in (install, uninstall):
        app.command(context_settings=_RAW, add_help_option=False)(command)


def install(context: typer.Context) -> None:
    """Install or update the service; --rollback goes back. See --help."""
    _forward("install", context)


def uninstall(context: typer.Context) -> None:
    """Take the service off this machine; sessions and calibrations stay. See --help."""
    _forward("uninstall", context)


def _forward(verb: str, context: typer.Context) -> None:
    """The options are those of `python -m vgrd.installing`, which runs where nothing is installed yet."""
    from vgrd.installing.__main__ import main

    main([verb, *context.args])
