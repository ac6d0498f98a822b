"""A restore that breaks off changes nothing, or leaves what a second one can work from, on one disk or on three."""

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.backup.computer import CELL, Computer
from vgrd.backup.archive import DIARY, LATCH
from vgrd.errors import StoreError
from vgrd.store.files import write_document

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
COUNTED = ("replace", "fsync", "copyfile")
UNCOUNTED = ("mkdir", "unlink", "rmdir")  # they break when one of the others did


class PowerCut(BaseException):
    """Nothing of ours runs any more."""


class Disks:
    """Of a computer, one or three. Counts what is done to them; breaks at a number, once or `stays` so."""

    def __init__(
        self,
        computer: Computer,
        several: bool,
        number: int = 10**6,
        error: BaseException = FULL,
        *,
        stays: bool = False,
    ) -> None:
        self.computer, self.several, self.error, self.stays = computer, several, error, stays
        self._left = number
        self._synced: set[int] = set()

    def restore(self, archive: Path) -> BaseException | None:
        """How it ended."""
        with pytest.MonkeyPatch.context() as patched:
            self.patch(patched)
            try:
                self.computer.restore(archive, replace=True)
            except (StoreError, PowerCut) as ended:
                return ended
        return None

    def patch(self, patched: pytest.MonkeyPatch) -> None:
        """Stand between the code and the disks."""
        for name in (*COUNTED, *UNCOUNTED):
            module = shutil if name == "copyfile" else os
            patched.setattr(module, name, self._standing_before(name, getattr(module, name)))

    def has_synced(self, path: Path) -> bool:
        """Whether a file or a folder was brought to the disk."""
        return path.stat().st_ino in self._synced

    @property
    def is_broken(self) -> bool:
        """Whether the number was reached."""
        return self._left <= 0

    def _standing_before(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def perform(*words: Any, **options: Any) -> Any:
            was_broken = self.is_broken
            self._left -= name in COUNTED
            if self.is_broken and (not was_broken or self.stays):
                if name == "copyfile":
                    Path(words[1]).write_text("half of it")
                raise self.error
            if name == "fsync":
                self._synced.add(os.fstat(words[0]).st_ino)
            if name == "replace":
                self._check_move(*map(Path, words))
            return real(*words, **options)

        return perform

    def _check_move(self, source: Path, target: Path) -> None:
        if self.several and self._disk(source) != self._disk(target):
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        if ".restoring" in source.parts:
            assert all(map(self.has_synced, (source, *source.rglob("*")))), source

    def _disk(self, path: Path) -> Path:
        folders = (self.computer.cell_file.parent, self.computer.state / "sessions")
        return next((one for one in folders if path.is_relative_to(one)), self.computer.state)


@pytest.fixture(autouse=True)
def _no_sync(monkeypatch) -> None:
    """A test's machine has other disks to wait for."""
    monkeypatch.setattr("os.fsync", lambda _: None)


@pytest.fixture(params=[False, True], ids=["one disk", "three disks"])
def several(request) -> bool:
    return request.param


@pytest.fixture
def old(tmp_path) -> Computer:
    """Little, since it is copied some hundred times."""
    computer = Computer(tmp_path / "old")
    computer.cell_file.write_text(CELL)
    computer.teach(1)
    return computer


@pytest.fixture
def archive(old, tmp_path) -> Path:
    for name in (LATCH, DIARY):
        write_document(old.state / name, {"of": "then"}, 1)
    return old.back_up(tmp_path / "cell.tar", sessions=True)


@pytest.fixture
def wanted(archive, old) -> dict[str, bytes]:
    """What is there after restoring."""
    return old.content()


@pytest.fixture
def newer(archive, wanted, old) -> Computer:
    """All of it went on since it was backed up."""
    old.teach(2)
    for name in (LATCH, DIARY):
        write_document(old.state / name, {"of": "now"}, 1)
    (old.state / "sessions" / "s1" / "note").write_text("of now")
    old.cell_file.write_text("# of now\n")
    return old


def every_break(newer: Computer, folder: Path, breaks: Callable[[Computer, int], bool]) -> None:
    """Break at every number, each time on a computer of its own."""
    number = 0
    while True:
        number += 1
        computer = newer.twin(folder / f"{number}")
        if not breaks(computer, number):
            break
        shutil.rmtree(folder / f"{number}")
    assert number > 30  # or there was nothing to break


def is_whole(computer: Computer, wanted: dict[str, bytes], before: dict[str, bytes]) -> None:
    """All of the archive is in place, and nothing is lost of what was there."""
    now = computer.content()
    assert {name: now.get(name) for name in wanted} == wanted
    assert set(before.values()) <= set(now.values())


def test_a_fault_changes_nothing(archive, newer, wanted, tmp_path, several) -> None:
    before = newer.content()

    def breaks(computer: Computer, number: int) -> bool:
        disks = Disks(computer, several, number)
        ended = disks.restore(archive)
        if ended is None:  # tidying may fail
            is_whole(computer, wanted, before)
        else:
            assert "free space" in str(ended)
            assert computer.content() == before, number
            assert not list(computer.state.glob("before-restore-*"))
        return disks.is_broken

    every_break(newer, tmp_path / "twins", breaks)


@pytest.mark.parametrize("error", [FULL, PowerCut()], ids=["a dead disk", "a power cut"])
def test_after_a_restore_that_could_not_be_undone_a_second_one_works(
    archive, newer, wanted, tmp_path, several, error
) -> None:
    before = newer.content()

    def breaks(computer: Computer, number: int) -> bool:
        disks = Disks(computer, several, number, error, stays=True)
        ended = disks.restore(archive)
        for name in (f"etc/{computer.cell_file.name}", f"state/{LATCH}"):
            assert computer.content()[name] in (wanted[name], before[name]), number
        kept = list(computer.state.glob("before-restore-*"))
        if isinstance(ended, StoreError):
            assert all(str(path) in str(ended) for path in kept), number
        computer.restore(archive, replace=True)
        is_whole(computer, wanted, before)
        return disks.is_broken

    every_break(newer, tmp_path / "twins", breaks)


def test_what_is_restored_is_on_the_disk(archive, spare, wanted, several) -> None:
    disks = Disks(spare, several)
    assert disks.restore(archive) is None
    for name in wanted:
        place = spare.state.parent / name
        assert disks.has_synced(place), name
        assert disks.has_synced(place.parent), name


def test_a_cell_file_that_is_a_link_stays_one(archive, newer, wanted) -> None:
    own = newer.state.parent / "own.toml"
    newer.cell_file.rename(own)
    newer.cell_file.symlink_to("../own.toml")
    restored = newer.restore(archive, replace=True)
    assert newer.cell_file.is_symlink()
    assert own.read_bytes() == wanted["etc/cell.toml"]
    assert (restored.set_aside / "cell.toml").read_text() == "# of now\n"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_root_restores_for_the_user_of_the_service_and_the_cell_file_stays_its_own(
    archive, spare, several
) -> None:
    os.chown(spare.state, 12345, 12346)
    spare.cell_file.write_text("# mine\n")
    spare.cell_file.chmod(0o640)
    os.chown(spare.cell_file, 0, 12346)
    assert Disks(spare, several).restore(archive) is None
    (aside,) = spare.state.glob("before-restore-*")
    own = [path for path in spare.state.rglob("*") if not path.is_relative_to(aside)]
    assert len(own) > 10
    assert {path.stat().st_uid for path in (*own, aside)} == {12345}
    for file in (spare.cell_file, aside / "cell.toml"):
        status = file.stat()
        assert (status.st_uid, status.st_gid, status.st_mode & 0o777) == (0, 12346, 0o640)


def test_sessions_are_set_aside_under_their_own_names(old, tmp_path) -> None:
    for name in ("calibrations", "cell.toml"):  # a session may be called so
        shutil.copytree(old.state / "sessions" / "s1", old.state / "sessions" / name)
    archive = old.back_up(tmp_path / "all.tar", sessions=True)
    old.teach(3)
    before = old.content()
    for name in ("calibrations", "cell.toml"):
        (old.state / "sessions" / name / "note").write_text(name)
    restored = old.restore(archive, replace=True)
    is_whole(old, {}, before)
    for name in ("calibrations", "cell.toml"):
        assert (restored.set_aside / "sessions" / name / "note").read_text() == name
        assert (old.state / "sessions" / name).stat().st_mode & 0o777 == 0o700


def test_two_restores_of_the_same_second_keep_apart_what_was_there(archive, newer, wanted) -> None:
    before = newer.content()
    first = newer.restore(archive, replace=True).set_aside
    newer.cell_file.write_text("# of later\n")
    second = newer.restore(archive, replace=True).set_aside
    assert first != second
    is_whole(newer, wanted, before)
    assert (second / "cell.toml").read_text() == "# of later\n"
