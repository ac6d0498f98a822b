"""An installation that breaks off at any step, by a fault, a full disk, Ctrl-C or a power cut, costs nothing.

Real steps on a real file system, in the folder of a trial; only Python, pip and vgrd are small scripts that
do nothing, or fail where they are told to.
"""

import errno
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from vgrd.errors import InputError, StepFailed
from vgrd.installing import __main__ as command
from vgrd.installing import execution, looking
from vgrd.installing.execution import Tell
from vgrd.installing.places import Places
from vgrd.installing.plans import PARTS
from vgrd.installing.steps import Step

PROJECT = Path(__file__).parents[2]
# An interpreter that says which it is, and makes an environment whose programs fail by order; a
# backup overwrites nothing, as that of vgrd.
INTERPRETER = """#!/bin/sh
[ "$2" = venv ] || {{ echo 3 11; echo /usr; exit; }}
mkdir -p "$3/bin"
for name in python vgrd; do
  cat > "$3/bin/$name" <<'END'
#!/bin/sh
if echo "$*" | grep -q -f {order}; then exit 1; fi
[ "$1" != backup ] || {{ mkdir -p "${{2%/*}}" && set -C && echo saved > "$2"; }}
END
  chmod 755 "$3/bin/$name"
done
"""
TAUGHT = "taught for an hour"
perform = execution._perform  # the real one, below the one that breaks


class PowerCut(BaseException):
    """Nothing of ours runs any more."""


class Machine:
    """The folder of a trial, with data in it that must outlive everything."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self.places = Places(folder / "root")
        self.cell, self._order = folder / "my.toml", folder / "order"
        self._interpreter = folder / "python"
        self._interpreter.write_text(INTERPRETER.format(order=self._order))
        self._interpreter.chmod(0o755)
        self._source = source_in(folder / "source")
        self.fail("nothing")
        self.cell.write_text("# mine\n")
        self.data = self.places.state / "calibrations" / "CURRENT"
        self.data.parent.mkdir(parents=True)
        self.data.write_text(TAUGHT)

    def fail(self, words: str) -> None:
        """From now on a program that is called with these words fails."""
        self._order.write_text(f"{words}\n")

    def repeat(self) -> None:
        """An update that goes well."""
        before = self.archives
        self.install()
        assert self.archives > before

    @property
    def archives(self) -> set[str]:
        """What was backed up before updates."""
        return {path.name for path in self.places.backups.glob("*.tar")}

    def vgrd(self, *words: str) -> None:
        """`vgrd ... --root DIR`."""
        command.main([*words, "--root", str(self.places.root)])

    def install(self) -> None:
        """`vgrd install --cell my.toml --root DIR`."""
        words = ["--cell", str(self.cell), "--python", str(self._interpreter)]
        self.vgrd("install", str(self._source), *words)

    @property
    def current(self) -> str:
        """Number of the version in use, "" without one."""
        link = self.places.current
        return link.readlink().name.rpartition("-")[2] if link.is_symlink() else ""

    @property
    def versions(self) -> set[str]:
        """Numbers of those that are there, whole or not."""
        return {path.name.rpartition("-")[2] for path in self.places.versions.glob("*-*")}


def source_in(folder: Path) -> Path:
    """The least that is a folder of the project: a test copies it some hundred times."""
    for part in PARTS:
        path = folder / part
        if (PROJECT / part).is_dir():
            path.mkdir(parents=True)
        else:
            path.write_text("")
    (folder / "vgrd/__init__.py").write_text('__version__ = "0.1.0"\n')
    for name in ("cell.example.toml", "vgrd.service", "vgrd.socket"):
        shutil.copy(PROJECT / "config" / name, folder / "config" / name)
    return folder


class Breaking:
    """Performs steps; the one of a number ends in an error, before it is done or after."""

    def __init__(self, number: int, error: BaseException, *, after: bool) -> None:
        self._left, self._error, self._after = number, error, after
        self.broke_at = ""

    def __call__(self, steps: Sequence[Step], tell: Tell) -> None:
        for step in steps:
            self._left -= 1
            breaks = self._left == 0
            if not breaks or self._after:
                perform([step], tell)
            if breaks:
                self.broke_at = str(step)
                perform([_Broken(step, self._error)], tell)  # type: ignore[list-item]


class _Broken:
    def __init__(self, step: Step, error: BaseException) -> None:
        self._step, self._error = step, error

    def __str__(self) -> str:
        return str(self._step)

    def perform(self) -> None:
        raise self._error


@pytest.fixture(autouse=True)
def _no_sync(monkeypatch) -> None:
    """A test's machine has other disks to wait for."""
    monkeypatch.setattr("os.sync", lambda: None)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path / "machine")


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize(
    "error",
    [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), PowerCut()],
    ids=lambda error: type(error).__name__,
)
def test_whatever_step_breaks_a_whole_version_is_in_use_and_the_next_try_succeeds(
    tmp_path, monkeypatch, error: BaseException, after: bool
) -> None:
    number = 0
    while True:
        number += 1
        machine = Machine(tmp_path / f"{number}")
        for _ in range(2):  # so that an older one is tidied away, too
            machine.install()
        breaking, said = Breaking(number, error, after=after), ""
        with monkeypatch.context() as patched:
            patched.setattr(execution, "_perform", breaking)
            try:
                machine.install()
            except (StepFailed, PowerCut) as broken:
                said = str(broken)
        assert breaking.broke_at in said or isinstance(error, PowerCut)
        if not breaking.broke_at:
            break
        assert machine.current in {"2", "3"}, breaking.broke_at
        whole = machine.places.current
        assert (whole / "bin/vgrd").exists(), breaking.broke_at
        assert (whole / "share/vgrd/config/vgrd.service").exists(), breaking.broke_at
        assert machine.data.read_text() == TAUGHT
        assert machine.places.cell_file.read_text() == "# mine\n"
        machine.install()
        assert machine.current >= "3", breaking.broke_at
        assert len(machine.versions) == 2, breaking.broke_at  # nothing half is left
    assert number > 20  # or there was nothing to break


def test_after_a_way_back_and_after_a_removal_there_are_updates_again(machine) -> None:
    for _ in range(2):
        machine.install()
    machine.vgrd("install", "--rollback")
    machine.repeat()
    machine.vgrd("uninstall")
    machine.install()
    assert machine.versions == {machine.current}
    machine.repeat()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("-m pip", "a folder with all packages: --wheels DIR"),
        ("-m vgrd.vision", "-m vgrd.vision"),
        ("check", "what runs now goes on"),
        ("-m vgrd.store", "vgrd restore"),
        ("backup", "vgrd backup"),
    ],
)
def test_a_program_that_fails_is_named_and_the_old_version_stays(machine, words, said) -> None:
    machine.install()
    machine.fail(words)
    with pytest.raises(StepFailed) as caught:
        machine.install()
    assert said in str(caught.value)
    assert "Nothing was changed that runs" in str(caught.value)
    assert (machine.current, machine.versions) == ("1", {"1"})


def test_a_first_cell_file_that_is_refused_does_not_stay_in_the_way_of_the_mended_one(
    machine,
) -> None:
    machine.fail("check")
    with pytest.raises(StepFailed, match="mend the cell file that --cell names"):
        machine.install()
    assert not machine.places.cell_file.exists()
    machine.fail("nothing")
    machine.cell.write_text("# mended\n")
    machine.install()
    assert machine.places.cell_file.read_text() == "# mended\n"


def test_a_cell_file_that_somebody_wrote_meanwhile_is_not_removed(machine, monkeypatch) -> None:
    class Meanwhile(Breaking):
        def __call__(self, steps: Sequence[Step], tell: Tell) -> None:
            machine.places.cell_file.parent.mkdir(parents=True, exist_ok=True)
            machine.places.cell_file.write_text("# by hand\n")
            super().__call__(steps, tell)

    broken = Meanwhile(3, OSError(errno.EIO, "disk"), after=False)
    monkeypatch.setattr(execution, "_perform", broken)
    with pytest.raises(StepFailed):
        machine.install()
    assert machine.places.cell_file.read_text() == "# by hand\n"


def test_a_cell_file_that_is_named_but_not_used_is_told(machine, capsys) -> None:
    machine.install()
    assert "stays as it was" not in capsys.readouterr().out
    machine.cell.write_text("# newer\n")
    machine.install()
    assert "cell.toml stays as it was" in capsys.readouterr().out
    assert machine.places.cell_file.read_text() == "# mine\n"


def test_a_machine_without_systemd_is_told_before_anything_is_written(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(looking, "_BOOTED", tmp_path / "nowhere")
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr(command, "alone", lambda _: pytest.fail("it went on"))
    for verb in ("install", "uninstall"):
        with pytest.raises(InputError, match=r"no systemd runs this machine.*--root DIR"):
            command.main([verb])


def test_who_is_not_root_is_told(monkeypatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr(command, "alone", lambda _: pytest.fail("it went on"))
    for words in (["install"], ["install", "--rollback"], ["uninstall"]):
        with pytest.raises(InputError, match="needs root: sudo"):
            command.main(words)


def test_an_older_python_is_told_which_it_must_be() -> None:
    code = "import sys; sys.version_info = (3, 9, 2); import vgrd.installing"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "needs Python 3.11 or newer" in done.stderr
    assert "Traceback" not in done.stderr
