"""A computer whose state is backed up and restored."""

import shutil
from pathlib import Path

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.backup import Restored, restore, write_archive
from vgrd.model import Plan
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import SampleKind, SessionWriter

CLOCK = ManualClock()
CELL = "# a cell\n"


class Computer:
    """State folder and cell file of one computer."""

    def __init__(self, folder: Path) -> None:
        self.state = folder / "state"
        self.cell_file = folder / "etc" / "cell.toml"
        self.store = CalibrationStore(self.state, CLOCK)
        self.cell_file.parent.mkdir(parents=True)
        self.state.mkdir(mode=0o700)

    def teach(self, seed: int) -> str:
        """Store one more calibration, put it in use, record its session."""
        samples = Samples(seed)
        name = self.store.save(samples.calibration())
        self.store.activate(name, "anna")
        with SessionWriter(self.state, f"s{seed}", Plan.JOINT, samples.facts(), CLOCK) as writer:
            writer.sample(SampleKind.TOUCH, samples.touch())
        return name

    def twin(self, folder: Path) -> "Computer":
        """Another one with the same content."""
        twin = Computer(folder)
        for mine, its in (
            (self.state, twin.state),
            (self.cell_file.parent, twin.cell_file.parent),
        ):
            shutil.copytree(mine, its, dirs_exist_ok=True)
        return twin

    def back_up(self, path: Path, *, sessions: bool = False) -> Path:
        """Write a backup."""
        write_archive(path, self.state, self.cell_file, "cell", CLOCK, sessions=sessions)
        return path

    def restore(self, path: Path, *, replace: bool = False) -> Restored:
        """Put one in place."""
        return restore(path, self.state, self.cell_file, CLOCK, replace=replace)

    def content(self) -> dict[str, bytes]:
        """All files but locks, by name."""
        tops = (self.state, self.cell_file.parent)
        files = (path for top in tops for path in top.rglob("*") if path.is_file())
        return {
            f"{p.relative_to(self.state.parent)}": p.read_bytes()
            for p in files
            if p.name != ".lock"
        }
