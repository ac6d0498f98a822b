"""The drivers there are, by name, loaded at run time: the daemon itself knows none."""

import importlib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.util import find_spec
from typing import cast

from vgrd.devices.interface import DriverCard

_CATALOGUE = "drivers.catalogue"  # its DRIVERS


def driver_cards() -> Mapping[str, DriverCard]:
    """The drivers that come with vgrd, by the name that a cell file gives them."""
    return cast("Mapping[str, DriverCard]", importlib.import_module(_CATALOGUE).DRIVERS)


def module_of(driver: str) -> str:
    """Name of a driver's module: `ur_rtde` is `drivers.ur_rtde`, a dotted name is taken as it stands."""
    return driver if "." in driver else f"drivers.{driver}"


def is_there(driver: str) -> bool:
    """Whether there is a module of a driver with a dotted name; what it needs is not loaded."""
    if not all(part.isidentifier() for part in driver.split(".")):
        return False
    try:
        return find_spec(driver) is not None
    except ModuleNotFoundError:  # not even the package that it would be in
        return False


def unknown_driver(name: str, kind: str | None = None) -> str:
    """What to say of a driver that is not there: the likely one, and those there are.

    kind: "robot", "camera" or "pedal", None for all of them.
    """
    cards = driver_cards()
    known = [key for key, card in cards.items() if kind in (None, card.kind)]
    close = get_close_matches(name, known, n=1)
    likely = f"did you mean {close[0]!r}? " if close else ""
    of_kind = "drivers" if kind is None else f"drivers of a {kind}"
    words = ", ".join(f"{key} ({cards[key].meaning})" for key in known)
    return f"there is no driver {name!r}: {likely}The {of_kind} there are: {words}"
