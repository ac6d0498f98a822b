"""Verifications of the calibration in use: the robot went where it was sent, and a person jogged the rest.

::

    STATE_DIR/trials/cal-000001.json    all of them, on the disk before one is acknowledged
"""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.confirmation import Confirmation, Verified, verified_of
from vgrd.calibration.verification import apart, judge, object_turn
from vgrd.cell.serving.service import Serving
from vgrd.clock import Clock
from vgrd.errors import ControlError, InputError, StoreError
from vgrd.geometry import Array
from vgrd.model import Touch
from vgrd.permissions import make_folder
from vgrd.store.files import read_document, write_document
from vgrd.store.sessions import load_recording, session_directory

FOLDER = "trials"
_SCHEMA = 1


class Trials:
    """Judges touches by what is served, and keeps what they told, calibration by calibration.

    A record names the calibration by its checksum, too: after a restore an id may be another's.
    """

    def __init__(self, serving: Serving, state_dir: Path, clock: Clock) -> None:
        self._serving, self._state_dir, self._clock = serving, state_dir, clock
        self._turn = asyncio.Lock()  # each change reads the file, then writes it
        self.changes = 0  # since the cell was started
        # Turns of the object while it was taught, and in which calibration.
        self._taught: tuple[int, list[Array | None]] = (0, [])

    async def add(self, touch: Touch) -> dict[str, Any]:
        """Judge a touch, keep it, and tell what all of them confirm. Raises StoreError."""
        calibration = self._calibration()
        stability = self._serving.cameras.stability
        turn = object_turn(touch)
        (judged,) = judge(calibration, [touch], stability)
        record = {
            "calid": self._serving.calibration_id,
            "unix_s": round(self._clock.wall(), 3),
            "turn": None if turn is None else turn.tolist(),
            **verified_of(
                touch, judged, counts=True
            ).to_json(),  # the others tell whether it counts
        }
        async with self._turn:
            await asyncio.to_thread(self._keep, calibration.id, record)
            self.changes += 1
        told = await self.tell()
        return {"target": touch.target, "off_mm": record["off_mm"], **told}

    async def undo(self) -> dict[str, Any]:
        """Take back the last one: it stays in the file, marked. InputError where there is none."""
        calibration = self._calibration()
        async with self._turn:
            undone = await asyncio.to_thread(self._undo, calibration.id)
            self.changes += 1
        told = await self.tell()
        return {"undone": f"verification of {undone['target']}, {undone['off_mm']} mm off", **told}

    async def tell(self) -> dict[str, Any]:
        """Of the calibration in use: its id, verdict, words, `confirmed_mm`, every verification."""
        calibration = self._calibration()
        return await asyncio.to_thread(self._told, calibration)

    def _calibration(self) -> Calibration:
        if self._serving.calibration is None:
            raise ControlError("no calibration is in use, so there is nothing to verify")
        return self._serving.calibration

    def _undo(self, name: str) -> Mapping[str, Any]:
        kept = self._kept(name)
        for record in reversed(kept):
            if self._is_of_this(record):
                record["undone"] = True
                write_document(self._file(name), kept, _SCHEMA)
                return dict(record)
        raise InputError(f"nothing undone: {name} has no verification that counts")

    def _keep(self, name: str, record: Mapping[str, Any]) -> None:
        make_folder(self._file(name).parent)
        write_document(self._file(name), [*self._kept(name), record], _SCHEMA)

    def _kept(self, name: str) -> list[Any]:
        if not self._file(name).exists():
            return []
        remedy = "move it away: earlier verifications are lost with it"
        return list(read_document(self._file(name), _SCHEMA, remedy))

    def _told(self, calibration: Calibration) -> dict[str, Any]:
        records = [one for one in self._kept(calibration.id) if self._is_of_this(one)]
        turns = [None if one["turn"] is None else np.array(one["turn"]) for one in records]
        counting = set(apart(self._turns_taught(calibration), turns))
        verified = tuple(
            Verified.from_json(one, counts=i in counting) for i, one in enumerate(records)
        )
        confirmed = Confirmation(verified, self._serving.limits.max_u95_mm)
        return {"calibration": calibration.id, **confirmed.to_json()}

    def _is_of_this(self, record: Mapping[str, Any]) -> bool:
        """Whether it counts for the calibration in use."""
        return record.get("calid") == self._serving.calibration_id and not record.get("undone")

    def _turns_taught(self, calibration: Calibration) -> list[Array | None]:
        """None where the session gave way: then verifications are compared among each other alone."""
        calid = self._serving.calibration_id
        if self._taught[0] != calid:
            try:
                folder = session_directory(self._state_dir, calibration.session)
                touches = load_recording(folder).touches
            except StoreError:
                touches = ()
            self._taught = calid, [object_turn(touch) for touch in touches]
        return self._taught[1]

    def _file(self, name: str) -> Path:
        return self._state_dir / FOLDER / f"{name}.json"
