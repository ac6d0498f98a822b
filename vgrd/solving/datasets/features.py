"""Features of a dataset: points fixed to the target, such as holes, that the pictures show too."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgrd.calibration.hand_eye import FeaturePlace
from vgrd.documents.tables import parse, tables_of
from vgrd.documents.toml import hint
from vgrd.solving.datasets.reading.document import FeatureTable, SampleTable
from vgrd.vision.print.boards import TargetSpec, has_direction
from vgrd.vision.print.targets import TagGrid

Places = Mapping[str, FeaturePlace | None]
_SIGHTINGS = 2  # two rays fix a point


def read_features(
    data: Mapping[str, Any],
    rows: Sequence[tuple[str, SampleTable]],
    target: TargetSpec | TagGrid | None,
    faults: list[str],
) -> Places:
    """Place on the target, None where unknown, by name; faults of [[feature]] and of sightings appended."""
    tables = tables_of(data, "feature", faults)
    if tables is None:
        return {}
    places: dict[str, FeaturePlace | None] = {}
    for index, table in enumerate(tables):
        parsed = parse(FeatureTable, table, f"feature[{index}]", faults)
        if parsed is None:
            continue
        if parsed.name in places:
            faults.append(f"feature: the name '{parsed.name}' is given twice, each needs its own")
        places[parsed.name] = _place(parsed)
    faults += _sighting_faults(places, rows)
    if target is not None and not has_direction(target):
        faults += [
            f"feature '{name}'.point_mm: the target looks the same after a half turn, so the place "
            "cannot be told from the opposite one; leave point_mm out, it is then estimated"
            for name, place in places.items()
            if place is not None
        ]
    return places


def _place(table: FeatureTable) -> FeaturePlace | None:
    if table.point_mm is None:
        return None
    return FeaturePlace(np.array(table.point_mm, dtype=np.float64), table.sigma_mm)


def _sighting_faults(places: Places, rows: Sequence[tuple[str, SampleTable]]) -> list[str]:
    faults = []
    for label, row in rows:
        faults += [
            f"{label}.features: '{name}' is no feature{hint(name, tuple(places))}"
            if places
            else f"{label}.features: '{name}' is no feature, add [[feature]] name = '{name}'"
            for name in row.features
            if name not in places
        ]
        if row.features and row.camera_from_target is not None:
            faults.append(f"{label}.features: pixels need image or points, not camera_from_target")
    for name, place in places.items():
        count = sum(name in row.features for _, row in rows)
        if place is None and count < _SIGHTINGS:
            faults.append(
                f"feature '{name}': seen in {count} samples and its place is not given; add point_mm, "
                f"or its pixel in {_SIGHTINGS} samples or more"
            )
    return faults
