"""Which calibration serves: loaded, checked and activated in a thread that may wait for disk and lock."""

import asyncio
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import structlog

from vgrd.calibration.adoption import TERM_S, adopt, bear_out, term_unix_s
from vgrd.calibration.calibration import Calibration
from vgrd.cell.serving.service import Serving
from vgrd.errors import CalibrationMismatch, InputError, VgrdError
from vgrd.model import CellFacts, Link, Touch
from vgrd.registers import Status
from vgrd.solving.servable import check_usable
from vgrd.store.calibrations import CalibrationStore, StoredCalibration

log = structlog.get_logger()


class Activation:
    """The way of a calibration from the store into `serving`, one change after the other."""

    def __init__(
        self,
        serving: Serving,
        store: CalibrationStore,
        facts: CellFacts,
        most_adopted: tuple[float, float] = (0.5, 5e-4),  # as the cell file
    ) -> None:
        """most_adopted: (mm, rad), of all slips since teaching that may be taken over."""
        self.serving = serving
        self.store = store
        self.facts = facts
        self.most_adopted = most_adopted
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

    async def adopt(self, link: Link, by: str) -> Mapping[str, object]:
        """Serve on with a tag that slipped, where it sits now. Raises InputError, StoreError.

        The calibration is a new one, so that robots see another CALID and `activate` takes it back.
        """
        calibration = self._calibration()
        slip = self.serving.faults.slip(link)
        now_unix_s = self.serving.clock.wall()
        new = adopt(calibration, slip, *self.most_adopted, by, now_unix_s)
        log.warning("slip_adopted", link=link.value, mm=slip.size_mm, rad=slip.size_rad)
        return {
            **await self._replace(new, by),
            "link": link.value,
            "slip_mm": round(slip.size_mm, 3),
            "slip_mrad": round(1e3 * slip.size_rad, 3),
            "verify_within_h": TERM_S / 3600,
        }

    async def bear_out(self, touch: Touch) -> Mapping[str, object]:
        """Let a verification touch bear out what was taken over; empty where nothing waits for it."""
        calibration = self.serving.calibration
        if calibration is None or math.isinf(term_unix_s(calibration)):
            return {}
        borne_out = bear_out(calibration, touch, self.serving.cameras.stability)
        if isinstance(borne_out, str):
            return {"adopted_slip": f"not borne out: {borne_out}"}
        replaced = await self._replace(borne_out, "verification")
        return {"adopted_slip": "borne out", **replaced}

    def _calibration(self) -> Calibration:
        if self.serving.calibration is None:
            raise InputError("no calibration serves, so nothing can be taken over")
        return self.serving.calibration

    async def _replace(self, calibration: Calibration, by: str) -> Mapping[str, object]:
        """Put it in use in place of the one that serves, unless that was replaced meanwhile."""
        former = self._calibration().id

        def replace_former() -> StoredCalibration:
            if self.store.current_id() != former:
                raise InputError("another calibration was activated meanwhile: ask again")
            name = self.store.save(calibration)
            return self.store.activate(name, by, lambda new: check_usable(new, self.facts))

        stored = await self._in_thread(replace_former)
        self._serve(stored)
        return {"calibration": stored.id, "register_id": f"{stored.register_id:08x}"}

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
