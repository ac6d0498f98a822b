"""The tables of DATASET.toml, strict: every fault is collected, with the key and what to do."""

import difflib
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.vision.print.boards import (
    BOARD_DICTIONARIES,
    TAG_DICTIONARIES,
    Charuco,
    Chessboard,
    CircleGrid,
    SingleTag,
    TargetSpec,
)

Count = Annotated[int, Field(ge=2, le=1000)]
LengthMm = Annotated[float, Field(ge=0.1, le=5000, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]


def one_of(known: tuple[str, ...]) -> AfterValidator:
    """Validator of a word out of a list; the message names the nearest one."""

    def check(word: str) -> str:
        if word not in known:
            raise ValueError(f"{word!r} is unknown{hint(word, known)}")
        return word

    return AfterValidator(check)


def hint(word: str, known: tuple[str, ...]) -> str:
    """Ending of a message about an unknown word: the nearest known one, or all of them."""
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f", did you mean '{close[0]}'?" if close else f"; known: {', '.join(sorted(known))}"


class Table(BaseModel):
    """A table of the file: strict, unknown keys are errors, immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


TableT = TypeVar("TableT", bound=Table)


class CameraTable(Table):
    """Intrinsics in px: fx fy cx cy; distortion in OpenCV's order; refine: estimate them too."""

    matrix: Annotated[list[Number], Field(min_length=4, max_length=4)]
    distortion: list[Number] = []
    refine: bool = False


class PosesTable(Table):
    """How the flange poses are written."""

    unit: Annotated[str, one_of(("mm", "m"))]
    rotation: Annotated[str, one_of(tuple(RotationFormat))]


class NamedTable(Table):
    """A table of which a file holds many; each has a name of its own."""

    name: Annotated[str, Field(min_length=1)]


NamedT = TypeVar("NamedT", bound=NamedTable)


class FeatureTable(NamedTable):
    """A point that is fixed to the target, such as a hole.

    point_mm: its place there, where known; sigma_mm: how well, per axis.
    """

    point_mm: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    sigma_mm: Annotated[float, Field(ge=1e-3, le=100, allow_inf_nan=False)] = 0.1


class SampleTable(NamedTable):
    """One sample: the flange's pose in the base, and what the camera saw; features: pixels by name."""

    pose: list[Number]
    image: str | None = None
    points: str | None = None
    camera_from_target: Annotated[list[Number], Field(min_length=16, max_length=16)] | None = None
    features: dict[str, Annotated[list[Number], Field(min_length=2, max_length=2)]] = {}


class CharucoTable(Table):
    """columns x rows squares."""

    type: Literal["charuco"]
    columns: Count
    rows: Count
    square_mm: LengthMm
    marker_mm: LengthMm
    dictionary: Annotated[str, one_of(BOARD_DICTIONARIES)]

    def spec(self) -> TargetSpec:
        """The target as the detector knows it; InputError when it cannot exist."""
        return Charuco(self.columns, self.rows, self.square_mm, self.marker_mm, self.dictionary)


class ChessboardTable(Table):
    """columns x rows inner corners."""

    type: Literal["chessboard"]
    columns: Annotated[int, Field(ge=3, le=1000)]
    rows: Annotated[int, Field(ge=3, le=1000)]
    square_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        return Chessboard(self.columns, self.rows, self.square_mm)


class CirclesTable(Table):
    """columns x rows circles."""

    type: Literal["circles", "asymmetric-circles"]
    columns: Count
    rows: Count
    spacing_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        asymmetric = self.type == "asymmetric-circles"
        return CircleGrid(self.columns, self.rows, self.spacing_mm, asymmetric)


class TagTable(Table):
    """One tag."""

    type: Literal["tag"]
    dictionary: Annotated[str, one_of(TAG_DICTIONARIES)]
    id: Annotated[int, Field(ge=0)]
    size_mm: LengthMm

    def spec(self) -> TargetSpec:
        """The target as the detector knows it."""
        return SingleTag(self.dictionary, self.id, self.size_mm)


TargetTable = CharucoTable | ChessboardTable | CirclesTable | TagTable
TARGET_TABLES: Mapping[str, type[TargetTable]] = {
    "charuco": CharucoTable,
    "chessboard": ChessboardTable,
    "circles": CirclesTable,
    "asymmetric-circles": CirclesTable,
    "tag": TagTable,
}


def parse(model: type[TableT], data: object, where: str, faults: list[str]) -> TableT | None:
    """The checked table, or None with every fault appended; `where` names the table."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults += [_fault(detail, where, tuple(model.model_fields)) for detail in error.errors()]
        return None


def tables_of(data: Mapping[str, Any], key: str, faults: list[str]) -> list[object] | None:
    """The [[key]] tables, empty without one; None with a fault appended where it is a single table."""
    tables = data.get(key, [])
    if isinstance(tables, list):
        return tables
    faults.append(f"{key}: is one table, write [[{key}]] with two brackets for each {key}")
    return None


def named_rows(
    model: type[NamedT], key: str, tables: Sequence[object], faults: list[str]
) -> list[tuple[str, NamedT]]:
    """The [[key]] tables that can be read, each with the words that name it in a message.

    Faults of all others, and of names given twice, are appended.
    """
    rows = []
    for index, table in enumerate(tables):
        name = table.get("name") if isinstance(table, dict) else None
        where = f"{key}[{index}]" + (f" '{name}'" if name is not None else "")
        row = parse(model, table, where, faults)
        if row is not None:
            rows.append((where, row))
    names = [row.name for _, row in rows]
    faults += [
        f"{key}: the name '{name}' is given {names.count(name)} times, each needs its own"
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    return rows


def _fault(detail: ErrorDetails, where: str, known: tuple[str, ...]) -> str:
    key = ".".join([where, *(str(part) for part in detail["loc"])])
    if detail["type"] == "extra_forbidden":
        return f"{key}: unknown key{hint(str(detail['loc'][-1]), known)}"
    if detail["type"] == "missing":
        return f"{key}: is missing, add it"
    if detail["type"] == "value_error":
        return f"{key}: {detail['msg'].removeprefix('Value error, ')}"
    return f"{key}: {detail['msg']} (got {detail['input']!r})"
