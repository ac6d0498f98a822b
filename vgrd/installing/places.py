"""Where an installation lies on a Debian machine, or below a folder that stands for one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

USER: Final = "vgrd"  # of the service, and the group of its operators
_BEFORE: Final = "before-"


@dataclass(frozen=True, slots=True)
class Places:
    """Paths of an installation; `root` is "/", or the folder of a trial in which all of it lies."""

    root: Path

    @property
    def is_trial(self) -> bool:
        """Not the machine itself: no users, no systemd."""
        return self.root != Path("/")

    @property
    def versions(self) -> Path:
        """Holds a virtual environment for each version, and the link `current`."""
        return self.root / "opt/vgrd"

    @property
    def current(self) -> Path:
        """Link to the version in use."""
        return self.versions / "current"

    @property
    def cell_file(self) -> Path:
        """The user's; written once, if it is not there."""
        return self.root / "etc/vgrd/cell.toml"

    @property
    def units(self) -> Path:
        """Where an administrator's units lie."""
        return self.root / "etc/systemd/system"

    @property
    def drop_ins(self) -> Path:
        """What the administrator changed of the service's unit."""
        return self.units / "vgrd.service.d"

    @property
    def sysusers(self) -> Path:
        """Tells systemd-sysusers of the service's user."""
        return self.root / "etc/sysusers.d/vgrd.conf"

    @property
    def profile(self) -> Path:
        """Tells the shells of all users where the cell file is."""
        return self.root / "etc/profile.d/vgrd.sh"

    @property
    def command(self) -> Path:
        """`vgrd` for all users."""
        return self.root / "usr/local/bin/vgrd"

    @property
    def state(self) -> Path:
        """Sessions and calibrations, unless the cell file says otherwise."""
        return self.root / "var/lib/vgrd"

    @property
    def cache(self) -> Path:
        """Compiled hot loops; CacheDirectory= of the unit."""
        return self.root / "var/cache/vgrd"

    @property
    def backups(self) -> Path:
        """One archive from before each update."""
        return self.root / "var/backups/vgrd"

    def archive(self, name: str) -> Path:
        """What was backed up before a version came into use."""
        return self.backups / f"{_BEFORE}{name}.tar"

    @property
    def archived(self) -> list[str]:
        """Versions before which a backup was written."""
        return [path.stem.removeprefix(_BEFORE) for path in self.backups.glob(f"{_BEFORE}*.tar")]

    def version(self, name: str) -> Path:
        """The virtual environment of a version."""
        return self.versions / name

    def source(self, name: str) -> Path:
        """What a version was installed from: its units, its example of a cell file, its profiles of robots."""
        return self.version(name) / "share/vgrd"

    def on_machine(self, path: Path) -> str:
        """How a path of ours is called on the machine that `root` stands for."""
        return f"/{path.relative_to(self.root)}"
