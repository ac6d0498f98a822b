"""A process table that `vgrd reload` left in the runtime folder, for the running gate to take over."""

from pathlib import Path

import structlog

from vgrd.errors import ConfigError
from vgrd.gate.settings import PROCESS_TABLE, WANTED_TABLE, GateSettings, load_settings

log = structlog.get_logger()


class WantedTable:
    """The gate looks for it; `asked_unix_s` names the last one, `refused` says why it is not in force."""

    def __init__(self, runtime_dir: Path) -> None:
        self.asked_unix_s = 0.0
        self.refused = ""
        self._wanted_path = runtime_dir / WANTED_TABLE
        self._present_path = runtime_dir / PROCESS_TABLE

    def take(self, present: GateSettings) -> GateSettings | None:
        """The wanted settings, from now on those of this run; None when there are none to take."""
        if not self._wanted_path.exists():
            return None
        asked_unix_s = 0.0
        try:
            wanted = load_settings(self._wanted_path)
            asked_unix_s = wanted.loaded_unix_s
            _check_address(wanted, present)
        except ConfigError as error:
            log.error("reload_refused", reason=str(error))  # noqa: TRY400  a line, not a trace
            self._wanted_path.unlink()
            self.asked_unix_s, self.refused = asked_unix_s, str(error)
            return None
        self._wanted_path.replace(self._present_path)
        return wanted

    def mark_in_force(self, settings: GateSettings) -> None:
        """Note that all processes run on these settings."""
        self.asked_unix_s, self.refused = settings.loaded_unix_s, ""


def _check_address(wanted: GateSettings, present: GateSettings) -> None:
    if _address(wanted) != _address(present):
        raise ConfigError(WANTED_TABLE, ["a new host, port or line_port needs a restart"])


def _address(settings: GateSettings) -> tuple[str, int, int | None]:
    return settings.host, settings.port, settings.line_port
