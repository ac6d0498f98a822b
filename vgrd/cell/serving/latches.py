"""Faults that a person must confirm, stored beyond the end of this process.

They are stored in two places. A ring in the runtime folder is written at once; a killed process
leaves it whole. A file in the state folder is written in a thread; it also outlives the service and a
restart of the machine. A fault that either of them holds is latched.
"""

import asyncio
import json
from pathlib import Path

import structlog

from vgrd.errors import IpcError, StoreError
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.permissions import make_folder
from vgrd.registers import Status
from vgrd.store.files import guarded, read_document, write_document

LATCH_RING = "latch.ring"
LATCH_FILE = "latch.json"
SCHEMA = 1  # of the file
_KIND = "latch"
_SLOTS, _BYTES = 2, 2048  # a ring has two slots at least; `_REASON` and its frame fit
_REASON = 300  # characters of a reason that are kept; six bytes each in JSON at most

Latch = tuple[Status, str]

log = structlog.get_logger()


class LatchBook:
    """Stores the latched fault. `latched` is at first what an earlier life of the cell left."""

    def __init__(self, runtime_dir: Path, state_dir: Path) -> None:
        self._file = state_dir / LATCH_FILE
        self.latched = _latch_in_ring(runtime_dir / LATCH_RING) or _latch_in_file(self._file)
        self.trouble = self._try_to_store(self.latched)  # before the ring that may hold it is new
        self._ring = RingWriter.create(runtime_dir / LATCH_RING, _SLOTS, _BYTES, _KIND)
        self._publish()
        self._noted_count = self._stored_count = 0
        self._stored = asyncio.Condition()
        self._wake = asyncio.Event()

    def note(self, latched: Latch | None) -> None:
        """Keep this; it is safe from a kill of this process when the call returns."""
        self.latched = latched
        self._publish()
        self._noted_count += 1
        self._wake.set()

    async def run(self) -> None:
        """Bring to the disk what was noted, until cancelled."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            count, latched = self._noted_count, self.latched
            self.trouble = await asyncio.to_thread(self._try_to_store, latched)
            async with self._stored:
                self._stored_count = count
                self._stored.notify_all()

    async def settled(self) -> None:
        """Wait until what was noted last is on the disk. Raises StoreError when it cannot be."""
        async with self._stored:
            await self._stored.wait_for(lambda: self._stored_count == self._noted_count)
        if self.trouble:
            raise StoreError(
                f"{self.trouble}. It is confirmed until the next start of the cell, and has to be "
                "confirmed again then"
            )

    def _publish(self) -> None:
        self._ring.publish(json.dumps(_document(self.latched)).encode(), stamp_s=0.0)

    def _try_to_store(self, latched: Latch | None) -> str:
        """Write or remove the file; why that was not possible, in words, else empty."""
        try:
            if latched is None:
                with guarded("remove", self._file):
                    self._file.unlink(missing_ok=True)
            else:
                with guarded("create", self._file.parent):
                    make_folder(self._file.parent)
                write_document(self._file, _document(latched), SCHEMA)
        except StoreError as err:
            log.error("latch_not_on_disk", reason=str(err))  # noqa: TRY400  a line, not a trace
            return str(err)
        return ""


def _document(latched: Latch | None) -> dict[str, object]:
    if latched is None:
        return {}
    status, reason = latched
    return {"status": int(status), "reason": reason[:_REASON]}


def _latch(document: object) -> Latch | None:
    """Inverse of `_document`; raises ValueError for what is none."""
    if document == {}:
        return None
    if not isinstance(document, dict) or document.keys() != {"status", "reason"}:
        raise ValueError(f"no latch: {document!r}")
    return Status(document["status"]), str(document["reason"])


def _latch_in_ring(path: Path) -> Latch | None:
    if not path.exists():
        return None
    try:
        with RingReader.open(path, _KIND) as ring:
            message = ring.newest()
        return None if message is None else _latch(json.loads(message.payload))
    except (IpcError, ValueError) as err:
        return _unreadable(path, err)


def _latch_in_file(path: Path) -> Latch | None:
    try:
        with guarded("read", path):
            is_there = path.exists()
        return _latch(read_document(path, SCHEMA)) if is_there else None
    except (StoreError, ValueError) as err:
        return _unreadable(path, err)


def _unreadable(path: Path, err: Exception) -> Latch:
    """What was latched is not known, so something is."""
    return Status.INTERNAL_ERROR, (
        f"{path} is unreadable ({err}): a fault may have been latched; check the cell, "
        "then: vgrd confirm"
    )
