"""Tables of a document: strict, every fault collected with the key and what to do."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from vgrd.documents.text import shortened
from vgrd.documents.toml import hint
from vgrd.documents.toml_lines import Location

Number = Annotated[float, Field(allow_inf_nan=False)]
LengthMm = Annotated[float, Field(ge=0.1, le=5000, allow_inf_nan=False)]  # catches 25 mm in m, um
Hint = Callable[[str, Collection[str]], str]


class FaultAt(ValueError):
    """What a check of a whole table finds wrong with one of its keys; `where` leads from the table to it."""

    def __init__(self, message: str, *where: int | str) -> None:
        self.where: Location = where
        super().__init__(message)


class Table(BaseModel):
    """A table of the file: strict, unknown keys are errors, immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class NamedTable(Table):
    """A table of which a file holds many; each has a name of its own."""

    name: Annotated[str, Field(min_length=1)]


TableT = TypeVar("TableT", bound=Table)
NamedT = TypeVar("NamedT", bound=NamedTable)


def one_of(known: tuple[str, ...]) -> AfterValidator:
    """Validator of a word out of a list; the message names the nearest one."""

    def check(word: str) -> str:
        if word not in known:
            raise ValueError(f"{shortened(repr(word))} is unknown{hint(shortened(word), known)}")
        return word

    return AfterValidator(check)


def parse(model: type[TableT], data: object, where: str, faults: list[str]) -> TableT | None:
    """The checked table, or None with every fault appended; `where` names the table."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults += faults_of(error, model, where)
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
        where = f"{key}[{index}]" + (f" '{shortened(str(name))}'" if name is not None else "")
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


def faults_of(
    error: ValidationError, model: type[Table], where: str = "", ending: Hint = hint
) -> list[str]:
    """Every fault with its key and remedy; `where` names the table, empty for the whole file.

    ending: of the message about an unknown key.
    """
    return [
        f"{'.'.join([*([where] if where else []), *map(_shown, place)]) or '(file)'}: {message}"
        for place, message in located_faults(error, model, ending, is_whole_file=not where)
    ]


def located_faults(
    error: ValidationError, model: type[Table], ending: Hint = hint, *, is_whole_file: bool = True
) -> list[tuple[Location, str]]:
    """Every fault as the place of its key and a message with the remedy; arguments as of `faults_of`."""
    return [
        (_place(detail), _message(detail, model, ending, is_whole_file=is_whole_file))
        for detail in error.errors()
    ]


def _shown(part: int | str) -> str:
    return shortened(str(part))


def _place(detail: ErrorDetails) -> Location:
    fault = detail.get("ctx", {}).get("error")
    return (*detail["loc"], *(fault.where if isinstance(fault, FaultAt) else ()))


def _message(
    detail: ErrorDetails, model: type[Table], ending: Hint, *, is_whole_file: bool
) -> str:
    location, given = detail["loc"], detail["input"]
    if detail["type"] == "extra_forbidden":
        return f"unknown key{ending(str(location[-1]), tuple(_keys(location[:-1], model)))}"
    if detail["type"] == "missing":
        return "is missing, add it"
    if detail["type"] == "value_error":  # raised by our own checks, which say what they were given
        return detail["msg"].removeprefix("Value error, ")
    if is_whole_file and len(location) == 1:
        return detail["msg"]  # a whole section, such as [[camera]] for [camera], is long
    in_metres = detail["type"].startswith("greater_than") and str(location[-1]).endswith("_mm")
    remedy = f"; in metres? Write {1000 * given:g}" if in_metres and given > 0 else ""
    return f"{detail['msg']} (got {shortened(repr(given))}){remedy}"


def _keys(location: Location, model: type[Table]) -> Iterator[str]:
    """Keys of the table at a place below `model`."""
    for part in location:
        if isinstance(part, str):
            model = _table_in(model.model_fields[part].annotation)
    yield from model.model_fields


def _table_in(annotation: object) -> type[Table]:
    """The class of the table inside an annotation such as `Annotated[list[TargetTable], ...]`."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next(_table_in(inner) for inner in get_args(annotation) if inner is not type(None))
