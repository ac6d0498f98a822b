"""Results of solved sessions as the solver told them, and their reports. Nothing here changes anything."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vgrd.cell.control.lines import Arguments, optional_text
from vgrd.cell.control.server import Operation
from vgrd.errors import InputError
from vgrd.reporting import report_of, report_page, stored_result
from vgrd.store.results import read_result
from vgrd.store.sessions import list_sessions, session_directory


class Results:
    """Operations `result` and `report`, of a session or of the newest that was solved."""

    def __init__(self, state_dir: Path) -> None:
        self._state_dir = state_dir

    def table(self) -> Mapping[str, Operation]:
        """Operations by name."""
        return {
            "result": Operation(self._result, ("session",)),
            "report": Operation(self._report, ("session",)),
        }

    async def _result(self, arguments: Arguments) -> Mapping[str, Any]:
        return await asyncio.to_thread(self._read, optional_text(arguments, "session"))

    async def _report(self, arguments: Arguments) -> Mapping[str, Any]:
        return await asyncio.to_thread(self._page, optional_text(arguments, "session"))

    def _read(self, session: str | None) -> Mapping[str, Any]:
        """Without a name: session None where nothing was solved yet."""
        if session is not None:
            return {"session": session, "result": stored_result(self._folder(session))}
        for name in reversed(list_sessions(self._state_dir)):
            if (result := read_result(self._folder(name))) is not None:
                return {"session": name, "result": result}
        return {"session": None, "result": None}

    def _page(self, session: str | None) -> Mapping[str, Any]:
        told = self._read(session)
        if told["session"] is None:
            raise InputError(
                "no session was solved yet, so there is nothing to report: vgrd solve"
            )
        folder = self._folder(told["session"])
        page = report_page(report_of(folder, self._state_dir, told["result"]))
        return {"session": told["session"], "html": page}

    def _folder(self, name: str) -> Path:
        return session_directory(self._state_dir, name)
