"""The whole of `vgrd check CELL.toml`: every remark on the file, in the order of its lines."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from vgrd.checking import machine, picture, work
from vgrd.checking.drivers import driver_remarks
from vgrd.checking.remarks import Remark, fault
from vgrd.config.cell_file import CellConfig, CellSection, read_cell, with_folders
from vgrd.config.page_section import PageSection
from vgrd.documents.tables import Table
from vgrd.documents.toml_lines import KeyPlaces

# Which sections each check reads: it is made where these are good, whatever the others are.
_Check = tuple[tuple[str, ...], Callable[..., Iterator[Remark]]]
_CHECKS: tuple[_Check, ...] = (
    (("serving", "robot"), machine.robot_reach_remarks),
    (("camera",), picture.camera_remarks),
    (("tags",), picture.tag_remarks),
    (("camera", "tags"), picture.lens_remarks),
    (("object",), work.target_remarks),
    (("object",), work.center_remarks),
    (("touch",), work.touch_remarks),
    (("robot",), work.robot_remarks),
    (("tool",), work.tool_remarks),
    (("pedal", "robot"), work.pedal_remarks),
    (("serving",), work.serving_remarks),
    (("page",), machine.page_remarks),
)


@dataclass(frozen=True, slots=True)
class CheckedCell:
    """A cell file and all remarks on it; config: None where it has faults of its own."""

    places: KeyPlaces
    config: CellConfig | None
    remarks: tuple[Remark, ...]

    def told(self, *, faults: bool) -> list[str]:
        """The faults, or the doubts, each in a line with line and key."""
        return [
            self.places.told(remark.where, remark.message)
            for remark in self.remarks
            if remark.is_fault is faults
        ]

    def to_json(self, *, faults: bool) -> list[dict[str, object]]:
        """As `told`, for programs."""
        return [one.to_json(self.places) for one in self.remarks if one.is_fault is faults]


def check_cell(path: Path, free_from: int | None = None) -> CheckedCell:
    """Check a file; no device is opened, nothing is written. ConfigError where it cannot be read at all.

    free_from: the lowest port that needs no privilege, None: as this machine has it.
    """
    places, config, faults = read_cell(path)
    data, good = places.data, _good_sections(places.data, path.resolve().parent)
    port = machine.first_free_port() if free_from is None else free_from
    checks: tuple[_Check, ...] = (
        *_CHECKS,
        (("cell",), partial(machine.folder_remarks, data=data)),
        (("serving",), partial(machine.address_remarks, free_from=port)),
    )
    remarks = [
        *(fault(message, *where) for where, message in faults),
        *driver_remarks(data),
        *(
            remark
            for names, check in checks
            if all(name in good for name in names)
            for remark in check(*(good[name] for name in names))
        ),
    ]
    remarks.sort(key=lambda remark: places.line(remark.where))
    return CheckedCell(places, config, tuple(remarks))


def _good_sections(data: Mapping[str, Any], folder: Path) -> dict[str, Table]:
    """The sections that are good by themselves; those left out are as their defaults."""
    good: dict[str, Table] = {}
    for name, field in CellConfig.model_fields.items():
        section = field.annotation
        if not (isinstance(section, type) and issubclass(section, Table)):
            continue
        try:
            good[name] = section.model_validate(data.get(name, {}))
        except ValidationError:
            continue  # the whole file tells it
    cell = good.get("cell")
    if isinstance(cell, CellSection):
        good["cell"] = with_folders(cell, folder)
    page = good.get("page")
    if isinstance(page, PageSection):
        good["page"] = page.with_files(folder)
    return good
