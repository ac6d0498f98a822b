"""The calibrations and sessions of a cell as lists for people."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vgrd.errors import InputError, NoCurrentCalibration, StoreError
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import list_sessions, load_session, session_directory


def calibration_list(
    store: CalibrationStore, known: dict[str, dict[str, Any]] | None = None
) -> dict[str, Any]:
    """Every stored calibration, which one is active, and who made which one active when.

    known: rows that were read before, which grows: a calibration never changes, and takes 0.2 s to read.
    """
    active, known = active_calibration(store), {} if known is None else known
    for name in store.list():
        if name not in known:
            known[name] = calibration_row(store, name)
    return {
        "folder": str(store.path),
        "active": active,
        "calibrations": [{**known[name], "active": name == active} for name in store.list()],
        "activations": [
            {
                "calibration": record.calibration,
                "previous": record.previous or None,
                "by": record.by,
                "when": _when(record.unix_s),
            }
            for record in store.activations()
        ],
    }


def active_calibration(store: CalibrationStore) -> str | None:
    """Id of the one in use, None for none."""
    try:
        return store.current_id()
    except NoCurrentCalibration:
        return None


def calibration_row(store: CalibrationStore, name: str) -> dict[str, Any]:
    """One calibration; a damaged file is told in its place, the others are listed all the same."""
    try:
        stored = store.load(name)
    except StoreError as err:
        return {"id": name, "verdict": str(err)}
    fatal = next((one.code for one in stored.verdict.findings if one.fatal), None)
    return {
        "id": name,
        "made": _when(stored.created_unix_s),
        "made_unix_s": stored.created_unix_s,
        "method": stored.method,
        "session": stored.session,
        "verdict": "good" if fatal is None else f"rejected: {fatal}",
        "u95_mm": _finite(stored.residuals.get("predicted_u95_mm")),
    }


def former_calibration(store: CalibrationStore) -> str:
    """Id of the one that was in use before the present one. InputError where there was none."""
    active = active_calibration(store)
    for record in reversed(store.activations()):
        if record.calibration == active and record.previous not in ("", active):
            return record.previous
    raise InputError(
        f"nothing to go back to: no other calibration was in use before {active or 'now'}; "
        "list them: vgrd calibrations"
    )


def session_list(state_dir: Path, open_session: str | None) -> list[Mapping[str, Any]]:
    """Every session, newest first; a damaged one is told in its place."""
    return [
        _session_row(state_dir, name, name == open_session)
        for name in reversed(list_sessions(state_dir))
    ]


def _session_row(state_dir: Path, name: str, is_open: bool) -> Mapping[str, Any]:
    try:
        stored = load_session(session_directory(state_dir, name))
    except StoreError as err:
        return {"name": name, "open": is_open, "trouble": str(err)}
    return {
        "name": name,
        "open": is_open,
        "plan": stored.header.plan.value,
        "begun": _when(stored.header.created_unix_s),
        "samples": {kind.value: len(n) for kind, n in stored.numbers.items() if n},
        "trouble": "; ".join(stored.warnings),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _when(unix_s: float) -> str:
    moment = datetime.fromtimestamp(unix_s, tz=UTC).astimezone()
    return moment.isoformat(sep=" ", timespec="seconds")
