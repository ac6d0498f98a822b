"""Writes docs/cell-file.md from the model of the cell file: `python -m vgrd.config.document FILE`."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from vgrd.config.cell_file import CellConfig
from vgrd.devices import DriverCard
from vgrd.devices.catalogue import driver_cards
from vgrd.documents.tables import Table

_INTRODUCTION = """\
# The cell file

Generated from `vgrd/config/cell_file.py` by `python -m vgrd.config.document docs/cell-file.md`.

TOML; units are part of the keys; an unknown key is an error. `vgrd check CELL.toml` tells all faults
at once, each with its line, and ends with 78; what is only odd it tells as a warning. It opens no device and
writes nothing. `vgrd check --connect CELL.toml` opens the devices too, and tells flange, TCP, and which tags a
picture shows. An example is `config/cell.example.toml`. `vgrd drivers` tells the drivers there are.
"""


def document() -> str:
    """The whole page."""
    lines = [_INTRODUCTION]
    for name, field in CellConfig.model_fields.items():
        lines += _section(name, field.annotation)
    for name, card in driver_cards().items():
        lines += _driver(name, card)
    return "\n".join(lines)


def _driver(name: str, card: DriverCard) -> Iterator[str]:
    """The settings of one driver."""
    extra = f" Comes with `vgrd[{card.extra}]`." if card.extra else ""
    yield f'## [{card.kind}.settings] of driver = "{name}"\n\n{card.meaning[0].upper()}{card.meaning[1:]}.{extra}\n'
    yield "| key | type | default | meaning |\n| --- | --- | --- | --- |"
    for setting in card.settings:
        default = "" if setting.default is None else f"`{setting.default}`"
        value = "required" if setting.is_required else default
        yield f"| {setting.key} | {setting.type} | {value} | {setting.meaning} |"
    yield ""


def _section(name: str, annotation: object) -> Iterator[str]:
    section = _section_type(annotation)
    if section is None:
        return
    inner = {k: f for k, f in section.model_fields.items() if _section_type(f.annotation)}
    plain = {k: f for k, f in section.model_fields.items() if k not in inner}
    bracket = f"[[{name}]]" if get_origin(annotation) or "list" in str(annotation) else f"[{name}]"
    yield f"## {bracket}\n\n{section.__doc__}\n"
    if plain:
        yield "| key | type | default | meaning |\n| --- | --- | --- | --- |"
        yield from (_row(key, field) for key, field in plain.items())
        yield ""
    for key, field in inner.items():
        yield from _section(f"{name}.{key}", field.annotation)


def _row(key: str, field: FieldInfo) -> str:
    meaning = field.description or ""
    return f"| {key} | {_type(field.annotation)} | {_default(field)} | {meaning} |"


def _section_type(annotation: object) -> type[Table] | None:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((found for a in get_args(annotation) if (found := _section_type(a))), None)


def _type(annotation: object) -> str:
    if get_origin(annotation) is Literal:
        return " or ".join(f"`{value!r}`".replace("'", '"') for value in get_args(annotation))
    names = [name for a in get_args(annotation) if a is not type(None) and (name := _type(a))]
    if get_origin(annotation) is list:
        return f"list of {names[0]}"
    if get_origin(annotation) is dict:
        return "table"
    return names[0] if names else str(getattr(annotation, "__name__", ""))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    return "" if field.default in (None, "", {}) else f"`{field.default}`"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
