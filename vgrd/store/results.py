"""What solving a session told, kept beside its samples: pages and reports read it long after."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vgrd.store.files import read_document, write_document

RESULT: Final = "result.json"
SCHEMA: Final = 1


def write_result(folder: Path, result: Mapping[str, Any]) -> None:
    """Keep the result of a session folder in place of an earlier one. Raises StoreError."""
    write_document(folder / RESULT, dict(result), SCHEMA)


def read_result(folder: Path) -> dict[str, Any] | None:
    """What was told last, None where the session was never solved. Raises StoreError, Corrupt."""
    if not (folder / RESULT).exists():
        return None
    body = read_document(folder / RESULT, SCHEMA, "solve the session again: vgrd solve")
    return dict(body) if isinstance(body, dict) else None
