"""Drivers that are there, and settings that they take; no device is opened."""

from collections.abc import Iterator, Mapping
from typing import Any

from vgrd.checking.remarks import Remark, doubt, fault
from vgrd.devices import DEPTHS, DriverCard
from vgrd.devices.catalogue import driver_cards, is_there, unknown_driver

_KINDS = ("robot", "camera", "pedal")
_GREY = "Mono8"
_DEEP_GREY = tuple(f"Mono{bits}" for bits in DEPTHS)


def driver_remarks(data: Mapping[str, Any]) -> Iterator[Remark]:
    """On the tables of the devices, as the file has them: they need not be good otherwise."""
    for kind in _KINDS:
        table = data.get(kind)
        driver = table.get("driver") if isinstance(table, Mapping) else None
        if isinstance(table, Mapping) and isinstance(driver, str) and driver:
            yield from _of_device(kind, driver, table)


def _of_device(kind: str, driver: str, table: Mapping[str, Any]) -> Iterator[Remark]:
    card = driver_cards().get(driver)
    if card is None:
        if "." not in driver or not is_there(driver):
            yield fault(unknown_driver(driver, kind), kind, "driver")
        return
    if card.kind != kind:
        here = unknown_driver(driver, kind).split(": ", 1)[1]
        yield fault(
            f"{driver} is a driver of a {card.kind}, not of a {kind}. {here}", kind, "driver"
        )
        return
    if trouble := card.trouble():
        yield fault(trouble, kind, "driver")
    settings = table.get("settings", {})
    if isinstance(settings, Mapping):
        yield from _of_settings(kind, card, settings)
        yield from _of_depth(kind, table, settings)


def _of_settings(kind: str, card: DriverCard, settings: Mapping[str, Any]) -> Iterator[Remark]:
    for remark in card.remarks(settings):
        yield Remark((kind, "settings", remark.key), remark.message, remark.is_fault)


def _of_depth(
    kind: str, table: Mapping[str, Any], settings: Mapping[str, Any]
) -> Iterator[Remark]:
    """Pictures of more than 8 bits do not fit into what is kept for those of 8."""
    wanted = settings.get("pixel_format", _GREY)
    if kind == "camera" and table.get("bits", 8) == 8 and wanted in _DEEP_GREY:
        words = f"{wanted} has more than the 8 bits of a pixel that are kept: write bits = 16 in [camera]"
        yield fault(words, kind, "settings", "pixel_format")
    if kind == "camera" and table.get("bits") == 16 and wanted == _GREY:
        words = "16 bits of a pixel, and settings.pixel_format is Mono8: set it, or leave bits out"
        yield doubt(words, kind, "bits")
