"""The files of a session: their names, the kinds of samples, the header.

::

    STATE_DIR/sessions/NAME/
      session.json      plan and cell facts, sealed by a checksum
      samples.jsonl     one line per taught sample, on the disk before it is acknowledged
      closed.json       how many lines that are, written when the session is closed
      result.json       what solving it told last, see `results`
      000.mcap ...      flange poses, observations, pictures; `.mcap.open` while growing, the
                        original of a recovered one is `.mcap.damaged`
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from filelock import FileLock

from vgrd.errors import InputError
from vgrd.model import CellFacts, Observation, Plan, Recording, Touch
from vgrd.store import migrations
from vgrd.store.files import LOCK_MODE, guarded

SCHEMA = migrations.SESSION_SCHEMA
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")
HEADER, SAMPLES, _LOCK = "session.json", "samples.jsonl", ".lock"
CLOSED = "closed.json"
UNDO, RETAG = "undo", "retag"  # lines that change an earlier one, which stays in the file


class SampleKind(StrEnum):
    """What was taught: looks and spins are Observations, the others Touches."""

    LOOK = "look"
    SPIN = "spin"
    TOUCH = "touch"
    POINT = "point"
    VERIFY = "verify"

    @property
    def value_type(self) -> type[Observation] | type[Touch]:
        """Class of the samples of this kind."""
        return Observation if self in (SampleKind.LOOK, SampleKind.SPIN) else Touch


@dataclass(frozen=True, slots=True, eq=False)
class SessionHeader:
    """Content of session.json; unix_minus_monotonic_s turns cell clock stamps into Unix time."""

    name: str
    plan: Plan
    facts: CellFacts
    created_unix_s: float
    unix_minus_monotonic_s: float


@dataclass(frozen=True, slots=True, eq=False)
class StoredSession:
    """A session as found on the disk; warnings tell what was left out or not tidied up.

    harvested: how many of the samples nobody asked for, by kind. last_by_foot: target of the last touch
    whose name was taken from the order of the targets, None where every touch was named. numbers: of the
    samples, by kind in the order of the recording.
    """

    header: SessionHeader
    recording: Recording
    warnings: tuple[str, ...]
    harvested: Mapping[SampleKind, int]
    last_by_foot: str | None = None
    numbers: Mapping[SampleKind, tuple[int, ...]] = field(default_factory=dict)


def session_directory(state_dir: Path, name: str) -> Path:
    """Where the session lives; raises InputError for a name that is not a plain file name."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"session name {name!r}: use 1 to 80 letters, digits, '.', '_' or '-', "
            "a letter or digit first"
        )
    return state_dir / "sessions" / name


def list_sessions(state_dir: Path) -> tuple[str, ...]:
    """Names of all sessions, oldest first."""
    folder = state_dir / "sessions"
    with guarded("list", folder):
        headers = folder.glob(f"*/{HEADER}")
        named = (path for path in headers if _NAME.fullmatch(path.parent.name))
        dated = sorted((path.stat().st_mtime_ns, path.parent.name) for path in named)
    return tuple(name for _, name in dated)


def session_lock(directory: Path) -> FileLock:
    """Held by the process that records into a session, recovers or removes it."""
    return FileLock(directory / _LOCK, mode=LOCK_MODE, thread_local=False)
