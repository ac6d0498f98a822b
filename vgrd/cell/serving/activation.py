"""Which calibration serves: loaded, checked and activated in a thread that may wait for disk and lock."""

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import structlog

from vgrd.cell.serving.service import Serving
from vgrd.errors import CalibrationMismatch, VgrdError
from vgrd.model import CellFacts
from vgrd.registers import Status
from vgrd.solving.servable import check_usable
from vgrd.store.calibrations import CalibrationStore, StoredCalibration

log = structlog.get_logger()


class Activation:
    """The way of a calibration from the store into `serving`, one change after the other."""

    def __init__(self, serving: Serving, store: CalibrationStore, facts: CellFacts) -> None:
        self.serving = serving
        self.store = store
        self.facts = facts
        self._shelf = ThreadPoolExecutor(1, thread_name_prefix="store")

    async def load_current(self) -> None:
        """Serve with the calibration in use, or let registers and status say why not."""
        try:
            stored = await self._in_thread(self._usable_current)
        except CalibrationMismatch as err:
            self._serve_none(Status.CALIBRATION_MISMATCH, str(err))
        except VgrdError as err:
            self._serve_none(Status.NOT_CALIBRATED, str(err))
        else:
            self._serve(stored)

    async def activate(self, name: str, by: str) -> Mapping[str, object]:
        """Put calibration `name` in use. Raises InputError, StoreError; the former one then serves on."""
        stored = await self._in_thread(
            lambda: self.store.activate(
                name, by, lambda calibration: check_usable(calibration, self.facts)
            )
        )
        self._serve(stored)
        return {"calibration": name, "register_id": f"{stored.register_id:08x}"}

    def _usable_current(self) -> StoredCalibration:
        stored = self.store.current()
        check_usable(stored.calibration, self.facts)
        return stored

    def _serve(self, stored: StoredCalibration) -> None:
        self.serving.use(stored.calibration, stored.register_id)
        log.info("calibration", in_use=stored.id)

    def _serve_none(self, status: Status, reason: str) -> None:
        self.serving.serve_none(status, reason)
        log.warning("calibration_unusable", status=status.name, reason=reason)

    async def _in_thread(self, work: Callable[[], StoredCalibration]) -> StoredCalibration:
        return await asyncio.get_running_loop().run_in_executor(self._shelf, work)
