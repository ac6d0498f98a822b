"""What the report of a session is made of, read from its folder."""

import base64
import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vgrd.errors import InputError, StoreError
from vgrd.judging.operator_time import operator_minutes
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.results import RESULT, read_result
from vgrd.store.sessions import StoredSession, iterate_images, load_session
from vgrd.vision.images.previews import preview

_PICTURE_PX = 720  # wide: a printed page shows no more
_HASHED = ("session.json", "samples.jsonl", RESULT)


@dataclass(frozen=True, slots=True, eq=False)
class SessionReport:
    """Facts of one session; result: see `read_result`. hashes: sha256 by file. picture: JPEG in base64, or ""."""

    session: StoredSession
    result: Mapping[str, Any]
    hashes: Mapping[str, str]
    activated: str
    minutes: Mapping[str, float]
    picture: str


def report_of(folder: Path, state_dir: Path | None, result: Mapping[str, Any]) -> SessionReport:
    """Read everything. state_dir: where its calibration is, None where it is not kept. Raises StoreError."""
    session = load_session(folder)
    taught = {
        kind.value: len(numbers) - session.harvested.get(kind, 0)
        for kind, numbers in session.numbers.items()
    }
    hashes = {name: _sha256(folder / name) for name in _HASHED if (folder / name).exists()}
    activated = ""
    name = result.get("calibration")
    if state_dir is not None and name is not None:
        store = CalibrationStore(state_dir)
        with suppress(InputError, StoreError):  # removed since, or damaged: no hash is told
            hashes[f"{name}.json"] = store.read(name).sha256
        by = [one.by for one in store.activations() if one.calibration == name]
        activated = f"activated by {by[-1] or 'somebody'}" if by else "never activated"
    return SessionReport(
        session, result, hashes, activated, operator_minutes(taught), _picture(folder)
    )


def _picture(folder: Path) -> str:
    """The first whole picture that is still there."""
    for image in iterate_images(folder):
        return base64.b64encode(preview(image.pixels, _PICTURE_PX)[0]).decode()
    return ""


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def stored_result(folder: Path) -> Mapping[str, Any]:
    """Of a session that was solved; InputError with the remedy where it was not."""
    result = read_result(folder)
    if result is None:
        raise InputError(
            f"session {folder.name} was not solved yet, so there is no verdict: vgrd solve"
        )
    return result
