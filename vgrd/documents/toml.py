"""Reading of a TOML file, and the nearest known word for one that is not known."""

import difflib
import tomllib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeVar

from vgrd.documents.text import SHOWN, read_text, shortened
from vgrd.documents.toml_lines import KeyPlaces, key_places
from vgrd.errors import ConfigError, InputError

_TABLES = (".csv", ".tsv", ".txt", ".json", ".yaml", ".yml", ".npz")  # what vgrd import reads
_T = TypeVar("_T")
_ALIKE = 0.6  # difflib's own cutoff: finds a slip of the fingers, no other word


def read_toml(path: Path, kind: str) -> dict[str, Any]:
    """The tables of a TOML file; ConfigError when it is not there or cannot be read.

    kind: of file that is expected, such as "a board file", for the one who named a missing file.
    """
    return _read(path, kind, tomllib.loads)


def read_with_places(path: Path, kind: str) -> KeyPlaces:
    """As `read_toml`, with the line of every key."""
    return _read(path, kind, key_places)


def _read(path: Path, kind: str, parse: Callable[[str], _T]) -> _T:
    try:
        return parse(read_text(path))
    except InputError as error:
        remedy = "" if path.is_file() else f": give the path of {kind}"
        raise ConfigError(str(path), [f"{error}{remedy}"]) from error
    except RecursionError as error:
        raise ConfigError(str(path), ["not valid TOML: nested too deeply"]) from error
    except ValueError as error:  # also a whole number of more than 4300 digits
        is_table = kind == "a DATASET.toml" and path.suffix.lower() in _TABLES
        remedy = f"; vgrd import {path} makes {kind} of a table" if is_table else ""
        raise ConfigError(str(path), [f"not valid TOML: {error}{remedy}"]) from error


def hint(
    word: str, known: Collection[str], list_name: str = "known", alike: float = _ALIKE
) -> str:
    """Ending of a message about an unknown word: the nearest known one, or all of them.

    alike: share of the letters that the nearest word has to have in common.
    """
    close = difflib.get_close_matches(word, known, n=1, cutoff=alike)
    return (
        f", did you mean '{close[0]}'?" if close else f"; {list_name}: {', '.join(sorted(known))}"
    )


def unknown_keys(data: dict[str, Any], known: Collection[str]) -> list[str]:
    """A fault for each key of the whole file that is not known."""
    return [
        f"{shortened(key)}: unknown key{hint(key[:SHOWN], known)}"
        for key in data
        if key not in known
    ]


def one_word(
    data: dict[str, Any], key: str, known: Collection[str], example: str, faults: list[str]
) -> str | None:
    """The known word under a key of the whole file, or None with a fault appended.

    example: what to add where the key is missing.
    """
    value = data.get(key)
    if isinstance(value, str) and value in known:
        return value
    if value is None:
        faults.append(f"{key}: is missing, add {key} = {example}")
    else:
        faults.append(
            f"{key}: {shortened(repr(value))} is unknown{hint(str(value)[:SHOWN], known)}"
        )
    return None
