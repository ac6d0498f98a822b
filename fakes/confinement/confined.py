"""The daemon of a fake cell as the shipped unit runs it: rendered, confined, told about by its messages."""

import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from fakes.cell.daemon import Daemon, has_devices
from fakes.confinement.booted import Booted
from vgrd.ipc.control import ControlClient

PROJECT = Path(__file__).parents[2]
TEMPLATE = PROJECT / "config" / "vgrd.service"


def render(cell_file: Path, unit_file: Path, template: str = "") -> Path:
    """Write the unit for a cell file and this environment, as an installation does."""
    text = template or TEMPLATE.read_text(encoding="utf-8")
    unit_file.write_text(text.replace("@CELL@", str(cell_file)).replace("@VENV@", sys.prefix))
    return unit_file


def visible(*more: Path) -> list[str]:
    """What must be seen though it may lie in a home or in /tmp: code, interpreter, cell file."""
    return [str(path) for path in (PROJECT, Path(sys.prefix), Path(sys.base_prefix), *more)]


def take_folders_from_unit(cell_file: Path) -> None:
    """Make a cell file leave its folders to the unit, as it does under systemd."""
    lines = cell_file.read_text(encoding="utf-8").splitlines()
    directives = [line for line in lines if not line.startswith(("state_dir", "runtime_dir"))]
    cell_file.write_text("\n".join(directives) + "\n", encoding="utf-8")


class ConfinedDaemon(Daemon):
    """Daemon by `fakes.confinement.namespaces`; `heard` is what it told the service manager so far."""

    def __init__(
        self,
        cell_file: Path,
        log: Path,
        good: Callable[[dict[str, object]], bool] = has_devices,
    ) -> None:
        super().__init__(cell_file, log, good)
        self.unit = render(cell_file, cell_file.with_name("vgrd.service"))
        self._ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._ear.bind("")  # an abstract name of the kernel's choice
        self._ear.setblocking(False)

    def command(self) -> list[str]:
        """Through the confinement."""
        folder = self.cell_file.parent
        name = "@" + self._ear.getsockname()[1:].decode()
        settings = [f"NOTIFY_SOCKET={name}", "WATCHDOG_USEC=5000000"]
        confinement = [
            sys.executable,
            "-m",
            "fakes.confinement.namespaces",
            str(self.unit),
            str(folder),
        ]
        return ["env", *settings, *confinement, *visible(folder)]

    def heard(self) -> list[str]:
        """Lines of all messages since the last time."""
        lines: list[str] = []
        while True:
            try:
                lines += self._ear.recv(4096).decode().splitlines()
            except BlockingIOError:
                return lines

    def stop(self) -> float:
        """Stop it, and hang up."""
        took_s = super().stop()
        self.last_words = self.heard()
        self._ear.close()
        return took_s


class BootedDaemon(Daemon):
    """Daemon by a systemd of its own (`fakes.confinement.booted`), started and stopped by systemctl."""

    def __init__(self, booted: Booted, cell_file: Path, log: Path) -> None:
        super().__init__(cell_file, log)
        self.booted = booted
        self.runtime = booted.path("/run/vgrd")
        self.control = ControlClient(self.runtime / "control.sock")
        self.process = booted.process

    def __enter__(self) -> "BootedDaemon":
        self.booted.ask("start", "--no-block", "vgrd.service")
        self.wait_until(self.good, timeout_s=90.0)
        return self

    def pid_of(self, process: str) -> int:
        """Its number out here."""
        return self.booted.pid_out_here(super().pid_of(process))

    def stop(self) -> float:
        """By systemctl."""
        start = time.monotonic()
        self.booted.ask("stop", "vgrd.service")
        return time.monotonic() - start


def drop_in(log: Path, *more: Path) -> str:
    """What a test must add to the unit: a log without a journal, and code that lies in a home or in /tmp."""
    binds = "".join(f"BindReadOnlyPaths={path}\n" for path in visible(*more))
    is_at_home = any(path.startswith(("/root", "/home")) for path in visible())
    home = "ProtectHome=tmpfs\n" if is_at_home else ""
    return f"[Service]\nStandardOutput=append:{log}\nStandardError=append:{log}\n{home}{binds}"
