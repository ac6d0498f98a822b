"""What the daemon writes is for its user, or for one group, and for nobody else."""

import errno
import grp
import json
import os
import pwd
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.errors import DaemonUnreachable, InputError
from vgrd.gate.settings import save_table
from vgrd.ipc.control import ControlClient
from vgrd.ipc.health import HealthReporter
from vgrd.model import Plan
from vgrd.orphans import dying_with_us
from vgrd.permissions import (
    OTHERS,
    group_let_in,
    make_folder,
    opener,
    own_folder,
    take_after,
    way_in,
)
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import SampleKind, SessionWriter, load_session

GROUP_AND_OTHERS = 0o077
FOREIGN_GID = 12345  # of no group here; only root can give files to it
STATE, RUNTIME = ("sessions", "calibrations"), ("health", "processes.json", "gate.lock")

as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may give files away")


@pytest.fixture(params=[0o000, 0o022, 0o077, 0o027], ids="umask {:03o}".format)
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def tree(top: Path) -> Iterator[Path]:
    yield top
    yield from top.rglob("*")


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


def write_everything(state: Path, runtime: Path) -> None:
    """What gate, cell, devices and solver leave on the disk."""
    clock, samples = ManualClock(), Samples(1)
    name = CalibrationStore(state, clock).save(samples.calibration())
    CalibrationStore(state, clock).activate(name)
    with SessionWriter(state, "s1", Plan.JOINT, samples.facts(), clock) as writer:
        writer.sample(SampleKind.TOUCH, samples.touch())
        writer.observation(samples.observation())
        writer.tick()
    save_table(runtime, {"cell": "test"})
    HealthReporter(runtime, "cell", clock).report("ok")
    link = socket.socket(socket.AF_UNIX)
    link.bind(str(runtime / "control.sock"))
    take_after(runtime / "control.sock", runtime)
    link.close()


def test_whatever_the_umask_nothing_is_for_group_or_others(tmp_path, umask) -> None:
    state, runtime = tmp_path / "state", tmp_path / "run"
    own_folder(state, "", STATE)
    own_folder(runtime, "", RUNTIME)
    write_everything(state, runtime)
    written = [path for top in (state, runtime) for path in tree(top)]
    assert {path.name for path in written} > {"session.json", "samples.jsonl", "CURRENT", ".lock"}
    assert {path.name for path in written} > {"processes.json", "cell.ring", "control.sock"}
    assert [path for path in written if mode(path) & GROUP_AND_OTHERS] == []


def test_without_a_daemon_too_what_is_written_is_private(tmp_path, umask) -> None:
    tmp_path.chmod(0o755)
    write_state = tmp_path / "new" / "state"
    CalibrationStore(write_state, ManualClock()).save(Samples(1).calibration())
    assert [path for path in tree(tmp_path / "new") if mode(path) & GROUP_AND_OTHERS] == []


@as_root
def test_a_group_reads_and_connects_and_others_do_neither(tmp_path, umask, monkeypatch) -> None:
    monkeypatch.setattr("vgrd.permissions._number_of", lambda _: FOREIGN_GID)
    state, runtime = tmp_path / "state", tmp_path / "run"
    own_folder(state, "operators", STATE)
    own_folder(runtime, "operators", RUNTIME)
    write_everything(state, runtime)
    for path in (path for top in (state, runtime) for path in tree(top)):
        if path.name == ".lock":
            assert mode(path) == 0o600
            continue
        assert path.lstat().st_gid == FOREIGN_GID, path
        expected = 0o750 if path.is_dir() else 0o660 if path.is_socket() else 0o640
        assert mode(path) == expected, path


def lax(state: Path, runtime: Path) -> None:
    """Folders as earlier versions left them under umask 022."""
    before = os.umask(0o022)
    for folder in (state / "sessions" / "s1", state / "calibrations", runtime / "health"):
        folder.mkdir(parents=True)
    for file in (
        state / "calibrations" / "cal-000001.json",
        state / "sessions" / "s1" / "session.json",
        runtime / "processes.json",
        runtime / "health" / "cell.ring",
    ):
        file.write_text("kept")
    os.umask(before)


def test_old_folders_are_closed_and_their_content_is_kept(tmp_path) -> None:
    state, runtime = tmp_path / "state", tmp_path / "run"
    lax(state, runtime)
    outside = tmp_path / "outside"
    outside.write_text("not ours")
    outside.chmod(0o644)
    (state / "sessions" / "link").symlink_to(outside)
    assert own_folder(state, "", STATE) == []
    assert own_folder(runtime, "", RUNTIME) == []
    for path in (path for top in (state, runtime) for path in tree(top)):
        if not path.is_symlink():
            assert mode(path) & GROUP_AND_OTHERS == 0, path
            assert path.is_dir() or path.read_text() == "kept"
    assert mode(outside) == 0o644


@as_root
def test_a_folder_once_for_a_group_is_closed_to_it_when_the_key_is_gone(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr("vgrd.permissions._number_of", lambda _: FOREIGN_GID)
    state = tmp_path / "state"
    own_folder(state, "operators", STATE)
    CalibrationStore(state, ManualClock()).save(Samples(1).calibration())
    own_folder(state, "", STATE)
    assert [path for path in tree(state) if mode(path) & GROUP_AND_OTHERS] == []


@pytest.mark.parametrize("access", [0o755, 0o1777])
def test_a_folder_with_other_peoples_files_is_refused_and_left_as_it_is(tmp_path, access) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "thesis.txt").write_text("years of work")
    shared.chmod(access)
    with pytest.raises(InputError, match=r"shared.*a folder of the daemon's own"):
        own_folder(shared, "", STATE)
    assert mode(shared) == access


def test_a_private_folder_with_anything_in_it_will_do(tmp_path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir(mode=0o700)
    (folder / "notes.txt").write_text("")
    assert own_folder(folder, "", STATE) == []
    assert mode(folder) == 0o700


def test_a_group_that_does_not_exist_is_named_with_the_remedy(tmp_path) -> None:
    with pytest.raises(InputError, match=r"'no-such-group'.*groupadd"):
        own_folder(tmp_path / "state", "no-such-group", STATE)


@as_root
def test_what_root_solves_stays_readable_for_the_daemon(tmp_path) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o700)
    os.chown(folder, FOREIGN_GID, FOREIGN_GID)
    CalibrationStore(folder, ManualClock()).save(Samples(1).calibration())
    made = [path for path in tree(folder) if path.name != ".lock"]
    assert {path.stat().st_uid for path in made} == {FOREIGN_GID}


AS_ANOTHER_USER = """
import os, sys
from pathlib import Path
from vgrd.errors import InputError
from vgrd.permissions import own_folder
os.setgroups([]); os.setgid(12345); os.setuid(12345)
try:
    print([str(p) for p in own_folder(Path(sys.argv[1]), sys.argv[2], ("sessions", "calibrations"))])
except InputError as err:
    print("refused:", err)
"""


def as_another_user(folder: Path, group: str = "") -> str:
    done = subprocess.run(
        dying_with_us([sys.executable, "-c", AS_ANOTHER_USER, str(folder), group]),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return done.stdout


@pytest.fixture
def reachable(tmp_path_factory) -> Path:
    """A folder that another user gets to, unlike those of pytest."""
    folder = tmp_path_factory.mktemp("reachable")
    for part in (folder, *folder.parents):
        if part.stat().st_uid == os.geteuid() and not mode(part) & 0o001:
            part.chmod(mode(part) | 0o011)
    return folder


@as_root
def test_a_folder_of_another_owner_is_refused_when_open_and_taken_when_closed(reachable) -> None:
    folder = reachable / "state"
    (folder / "sessions").mkdir(parents=True)
    folder.chmod(0o777)
    assert "refused" in as_another_user(folder)
    os.chown(folder, 0, 12345)
    folder.chmod(0o770)
    answer = as_another_user(folder)
    assert "refused" not in answer
    assert str(folder / "sessions") in answer  # still open, and not its own to close


@as_root
def test_a_group_that_the_daemons_user_is_not_in_is_refused_with_the_remedy(reachable) -> None:
    folder = reachable / "state"
    folder.mkdir(mode=0o700)
    os.chown(folder, 12345, 12345)
    answer = as_another_user(folder, "daemon")
    assert "refused" in answer
    assert "Group=daemon" in answer


def test_an_open_file_keeps_its_content_and_a_session_stays_readable(tmp_path) -> None:
    folder = tmp_path / "a" / "b"
    make_folder(folder)
    make_folder(folder)
    with open(folder / "f", "w", opener=opener) as file:
        json.dump({"kept": True}, file)
    with open(folder / "f", "a", opener=opener) as file:
        file.write("\n")
    assert json.loads((folder / "f").read_text()) == {"kept": True}
    with pytest.raises(FileExistsError):
        make_folder(folder, exist_ok=False)
    writer = SessionWriter(tmp_path, "s", Plan.JOINT, Samples(2).facts(), ManualClock())
    writer.close()
    assert load_session(writer.path).warnings == ()
    assert mode(writer.path) & OTHERS == 0


@pytest.mark.parametrize(
    ("access", "is_let_in"), [(0o750, True), (0o700, False), (0o755, False), (0o710, False)]
)
def test_the_unit_says_by_its_folder_which_group_is_let_in(tmp_path, access, is_let_in) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    folder.chmod(access)
    group = group_let_in(folder)
    assert group == (folder.stat().st_gid if is_let_in else None)
    own_folder(folder, group, RUNTIME)
    assert mode(folder) == (0o750 if is_let_in else 0o700)


def test_who_is_not_let_in_is_told_the_way_in(tmp_path) -> None:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o750)
    group = grp.getgrgid(folder.stat().st_gid).gr_name
    assert f"adduser NAME {group}" in way_in(folder / "control.sock")
    folder.chmod(0o700)
    owner = pwd.getpwuid(os.getuid()).pw_name
    assert f"only user {owner} may" in way_in(folder / "control.sock")


def test_a_control_socket_that_is_closed_to_somebody_names_the_remedy(
    tmp_path, monkeypatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("vgrd.ipc.control.ControlClient._connect", refused)
    tmp_path.chmod(0o750)
    with pytest.raises(DaemonUnreachable, match=r"Permission denied; members of the group .* may"):
        ControlClient(tmp_path / "control.sock").call("status")
