"""The command that tells which drivers there are and what their settings mean."""

from typing import Annotated

import typer

from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import InputError


def register(app: typer.Typer) -> None:
    """Add drivers."""
    app.command()(drivers)


def drivers(
    driver: Annotated[
        str | None, typer.Argument(help="Only this one, such as ur_rtde; none: all of them.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Tell the drivers of robots, cameras and pedals, their settings, and whether they work here."""
    from vgrd.devices.catalogue import driver_cards, unknown_driver

    cards = driver_cards()
    if driver is not None and driver not in cards:
        raise InputError(unknown_driver(driver))
    result = {
        "drivers": [
            {
                "name": name,
                "kind": card.kind,
                "meaning": card.meaning,
                "extra": card.extra,
                "trouble": card.trouble(),
                "settings": [
                    {
                        "key": setting.key,
                        "type": setting.type,
                        "required": setting.is_required,
                        "default": setting.default,
                        "meaning": setting.meaning,
                    }
                    for setting in card.settings
                ],
            }
            for name, card in cards.items()
            if driver in (None, name)
        ]
    }
    print_result(result, json_to, _show)


def _show(result: Result) -> None:
    for driver in result["drivers"]:
        rows = [
            (
                setting["key"],
                setting["type"],
                "required" if setting["required"] else setting["default"],
                setting["meaning"],
            )
            for setting in driver["settings"]
        ]
        title = f"{driver['name']} ({driver['kind']}): {driver['meaning']}"
        console.print(table(title, ("setting", "type", "default", "meaning"), rows))
        extra = f"pip install 'vgrd[{driver['extra']}]'" if driver["extra"] else "vgrd itself"
        state = f"does not work here: {driver['trouble']}" if driver["trouble"] else "works here"
        console.print(f"comes with {extra}; {state}\n", highlight=False, markup=False)
