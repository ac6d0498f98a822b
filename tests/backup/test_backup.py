"""A backup gives back what it took, to the bit; what is no backup, or a torn one, changes nothing."""

import hashlib
import io
import os
import stat
import subprocess
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.world.samples import Samples
from tests.backup.computer import CELL, CLOCK, Computer
from vgrd.backup import write_archive
from vgrd.backup.archive import DIARY, LATCH, MANIFEST, SCHEMA, TRIALS
from vgrd.cell.serving.diary import FILE as DIARY_FILE
from vgrd.cell.serving.latches import LATCH_FILE
from vgrd.cell.serving.trials import FOLDER as TRIALS_FOLDER
from vgrd.errors import Corrupt, InputError, SchemaTooNew, StoreError, VgrdError
from vgrd.model import Plan
from vgrd.permissions import make_folder
from vgrd.store.files import read_document, write_document
from vgrd.store.sessions import SessionWriter, list_sessions, load_session


def test_a_spare_computer_serves_with_the_very_calibration(old, spare, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    restored = spare.restore(archive)
    assert restored.current == "cal-000002"
    assert restored.set_aside is None
    assert spare.store.current().sha256 == old.store.current().sha256
    assert spare.store.activations() == old.store.activations()
    assert spare.cell_file.read_text() == CELL
    assert list_sessions(spare.state) == ()
    made = [path for path in spare.state.rglob("*") if path.name != ".lock"]
    assert [path for path in made if stat.S_IMODE(path.stat().st_mode) & 0o077] == []


def test_with_sessions_all_of_it_comes_back(old, spare, tmp_path) -> None:
    spare.restore(old.back_up(tmp_path / "cell.tar", sessions=True))
    assert spare.content() == old.content()
    assert load_session(spare.state / "sessions" / "s1").warnings == ()


def test_a_fault_that_waits_for_a_person_waits_on_the_spare_computer_too(
    old, spare, tmp_path
) -> None:
    assert LATCH == LATCH_FILE
    write_document(old.state / LATCH, {"status": 503, "reason": "tag B slipped"}, 1)
    latched = old.back_up(tmp_path / "latched.tar")
    (old.state / LATCH).unlink()
    good = old.back_up(tmp_path / "good.tar")
    spare.restore(latched)
    assert "slipped" in (spare.state / LATCH).read_text()
    spare.restore(good, replace=True)  # no backup confirms a fault
    assert (spare.state / LATCH).exists()


def test_verifications_and_diary_come_back(old, spare, tmp_path) -> None:
    assert (DIARY, TRIALS) == (DIARY_FILE, TRIALS_FOLDER)
    make_folder(old.state / TRIALS)
    write_document(old.state / TRIALS / "cal-000002.json", [{"off_mm": 0.4}], 1)
    write_document(old.state / DIARY, {"hours": [], "faults": []}, 1)
    archive = old.back_up(tmp_path / "cell.tar")
    spare.restore(archive)
    for name in (f"{TRIALS}/cal-000002.json", DIARY):
        assert (spare.state / name).read_bytes() == (old.state / name).read_bytes()


def test_the_diary_of_a_spare_is_set_aside_unasked_and_its_verifications_are_not(
    old, spare, tmp_path
) -> None:
    write_document(old.state / DIARY, {"hours": [1], "faults": []}, 1)
    archive = old.back_up(tmp_path / "cell.tar")
    write_document(spare.state / DIARY, {"hours": [2], "faults": []}, 1)
    restored = spare.restore(archive)
    assert read_document(spare.state / DIARY, 1) == {"hours": [1], "faults": []}
    assert restored.set_aside is not None
    assert read_document(restored.set_aside / DIARY, 1) == {"hours": [2], "faults": []}
    make_folder(old.state / TRIALS)
    write_document(old.state / TRIALS / "cal-000002.json", [{"off_mm": 0.4}], 1)
    judged = old.back_up(tmp_path / "judged.tar")
    write_document(old.state / TRIALS / "cal-000002.json", [{"off_mm": 0.4}, {"off_mm": 0.5}], 1)
    with pytest.raises(InputError, match=r"trials: is not what .* --replace"):
        old.restore(judged)


def test_a_session_that_is_being_recorded_is_left_out_and_named(old, tmp_path) -> None:
    with SessionWriter(old.state, "now", Plan.JOINT, Samples(3).facts(), CLOCK):
        content = write_archive(
            tmp_path / "cell.tar", old.state, old.cell_file, "cell", CLOCK, sessions=True
        )
    assert content.left_out == ["now"]
    assert not [name for name in content.files if name.startswith("sessions/now/")]


def test_a_backup_overwrites_nothing(old, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    before = archive.read_bytes()
    with pytest.raises(InputError, match="overwrites nothing"):
        old.back_up(archive)
    assert archive.read_bytes() == before
    assert stat.S_IMODE(archive.stat().st_mode) & 0o077 == 0


def test_a_computer_without_any_state_is_backed_up_too(spare, tmp_path) -> None:
    spare.cell_file.write_text(CELL)
    archive = spare.back_up(tmp_path / "cell.tar")
    assert Computer(tmp_path / "third").restore(archive).current == ""


def test_restoring_the_same_changes_nothing(old, tmp_path) -> None:
    archive, before = old.back_up(tmp_path / "cell.tar"), old.content()
    assert old.restore(archive).set_aside is None
    assert old.content() == before


def test_a_state_that_went_on_is_kept_unless_it_is_said(old, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    old.teach(3)
    before = old.content()
    with pytest.raises(InputError, match=r"calibrations: is not what .* --replace"):
        old.restore(archive)
    assert old.content() == before
    restored = old.restore(archive, replace=True)
    assert old.store.current_id() == "cal-000002"
    assert restored.set_aside is not None
    assert (restored.set_aside / "calibrations" / "cal-000003.json").exists()
    assert list_sessions(old.state) == ("s1", "s2", "s3")


def test_a_state_that_the_backup_goes_on_from_gives_way(old, tmp_path) -> None:
    early = old.back_up(tmp_path / "early.tar")
    spare = Computer(tmp_path / "spare")
    spare.restore(early)
    old.teach(3)
    assert spare.restore(old.back_up(tmp_path / "late.tar")).current == "cal-000003"


@pytest.mark.parametrize("name", ["cal-000003.json", "thesis.txt", "folder"])
def test_what_is_in_no_archive_is_set_aside_if_it_is_said(old, tmp_path, name) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    more = old.state / "calibrations" / name
    if name == "cal-000003.json":  # solved, not activated
        old.store.save(Samples(3).calibration())
    elif name == "folder":
        more.mkdir()
    else:
        more.write_text("mine")
    with pytest.raises(InputError, match=r"calibrations: is not what .* --replace"):
        old.restore(archive)
    restored = old.restore(archive, replace=True)
    assert restored.current == old.store.current_id() == "cal-000002"
    assert not more.exists()
    assert (restored.set_aside / "calibrations" / name).exists()


def test_a_folder_where_a_file_belongs_is_set_aside_too(old, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    file = old.state / "calibrations" / "cal-000001.json"
    file.unlink()
    file.mkdir()
    restored = old.restore(archive, replace=True)
    assert file.is_file()
    assert (restored.set_aside / "calibrations" / file.name).is_dir()


def test_another_activation_is_newer_state_too(old, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    old.store.activate("cal-000001", "bruno")
    with pytest.raises(InputError, match="may be newer"):
        old.restore(archive)
    assert old.store.current_id() == "cal-000001"


def test_another_cell_file_is_kept_unless_it_is_said(old, spare, tmp_path) -> None:
    archive = old.back_up(tmp_path / "cell.tar")
    spare.cell_file.write_text("# mine\n")
    spare.cell_file.chmod(0o640)
    with pytest.raises(InputError, match=r"cell\.toml: is not what"):
        spare.restore(archive)
    assert spare.content() == {"etc/cell.toml": b"# mine\n"}
    restored = spare.restore(archive, replace=True)
    assert (restored.set_aside / "cell.toml").read_text() == "# mine\n"
    assert spare.cell_file.read_text() == CELL
    assert stat.S_IMODE(spare.cell_file.stat().st_mode) == 0o640


def refused(spare: Computer, archive: Path, *kinds: type[VgrdError]) -> str:
    """What restoring says; nothing may have changed by it."""
    before = spare.content()
    with pytest.raises(kinds or VgrdError) as caught:
        spare.restore(archive, replace=True)
    assert spare.content() == before
    assert not (spare.state / ".restoring").exists()
    return str(caught.value)


@pytest.fixture(scope="module")
def bytes_of_backup(tmp_path_factory) -> bytes:
    folder = tmp_path_factory.mktemp("backup")
    computer = Computer(folder / "old")
    computer.cell_file.write_text(CELL)
    computer.teach(1)
    return computer.back_up(folder / "cell.tar").read_bytes()


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_torn_backup_is_refused_wherever_it_was_torn(
    tmp_path_factory, bytes_of_backup, data
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    last = len(bytes_of_backup.rstrip(b"\0"))  # behind it there is only the padding of tar
    archive = folder / "torn.tar"
    archive.write_bytes(bytes_of_backup[: data.draw(st.integers(0, last - 1))])
    refused(Computer(folder / "spare"), archive, Corrupt, InputError)


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_flipped_bit_is_found_or_was_of_no_meaning(
    tmp_path_factory, bytes_of_backup, data
) -> None:
    folder = tmp_path_factory.mktemp("flipped")
    damaged = bytearray(bytes_of_backup)
    place = data.draw(st.integers(0, len(damaged) - 1))
    damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    archive = folder / "flipped.tar"
    archive.write_bytes(damaged)
    spare, good = Computer(folder / "spare"), Computer(folder / "good")
    (folder / "good.tar").write_bytes(bytes_of_backup)
    good.restore(folder / "good.tar")
    try:
        spare.restore(archive)
    except VgrdError:
        assert spare.content() == {}
    else:
        assert spare.content() == good.content()


def tar_of(path: Path, *members: tuple[tarfile.TarInfo, bytes]) -> Path:
    with tarfile.open(path, "w") as archive:
        for member, data in members:
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    return path


def member(name: str, kind: bytes = tarfile.REGTYPE, link: str = "") -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, link
    return info


@pytest.mark.parametrize(
    "wrong",
    [
        member("../../etc/passwd"),
        member("/etc/passwd"),
        member("calibrations/../../x"),
        member("calibrations/cal-000001.json/../../../x"),
        member("sessions/../x/y"),
        member("sessions/a/../../../x"),
        member("sessions/.ssh/keys"),
        member("thesis.txt"),
        member("calibrations/CURRENT", tarfile.SYMTYPE, "/etc/passwd"),
        member("calibrations/CURRENT", tarfile.LNKTYPE, "/etc/passwd"),
        member("calibrations/CURRENT", tarfile.FIFOTYPE),
        member("calibrations/CURRENT", tarfile.CHRTYPE),
        member("calibrations", tarfile.DIRTYPE),
    ],
    ids=lambda info: f"{info.name} {info.type.decode()}",
)
def test_nothing_is_written_outside_whatever_an_archive_says(spare, tmp_path, wrong) -> None:
    archive = tar_of(
        tmp_path / "evil.tar", (wrong, b"" if wrong.type != tarfile.REGTYPE else b"x")
    )
    before = {path for path in tmp_path.rglob("*") if ".restoring" not in path.parts}
    assert "nothing was taken from it" in refused(spare, archive, InputError)
    assert set(tmp_path.rglob("*")) == before


def test_a_hole_of_a_terabyte_is_not_written_to_the_disk(spare, tmp_path) -> None:
    sparse = member("cell.toml")
    sparse.pax_headers = {"GNU.sparse.size": str(10**12), "GNU.sparse.map": "0,1"}
    archive = tar_of(tmp_path / "sparse.tar", (sparse, b"x"))
    with tarfile.open(archive) as opened:
        assert opened.getmember("cell.toml").size == 10**12
    assert "nothing was taken from it" in refused(spare, archive, InputError)


def test_the_same_name_twice_is_refused(spare, tmp_path) -> None:
    twice = [(member("cell.toml"), b"a"), (member("cell.toml"), b"b")]
    refused(spare, tar_of(tmp_path / "twice.tar", *twice), InputError)


@pytest.mark.parametrize(
    "make",
    [lambda p: p.write_bytes(b"PK" * 999), lambda p: p.write_bytes(b""), lambda p: tar_of(p)],
)
def test_what_is_no_backup_is_refused(spare, tmp_path, make: Callable[[Path], object]) -> None:
    make(tmp_path / "other.tar")
    refused(spare, tmp_path / "other.tar", Corrupt, InputError)


def sealed(folder: Path, files: dict[str, bytes], schema: int = SCHEMA) -> Path:
    """An archive whose list is right, whatever is in it."""
    sums = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    body = {"cell": "c", "created_unix_s": 1.0, "files": sums}
    write_document(folder / "list", body, schema)
    all_files = {**files, MANIFEST: (folder / "list").read_bytes()}
    return tar_of(folder / "made.tar", *((member(n), d) for n, d in all_files.items()))


def test_a_backup_by_a_newer_version_is_refused_as_the_store_does(spare, tmp_path) -> None:
    refused(spare, sealed(tmp_path, {"cell.toml": b"x"}, schema=SCHEMA + 1), SchemaTooNew)


def test_a_calibration_by_a_newer_version_is_refused_as_the_store_does(spare, tmp_path) -> None:
    write_document(tmp_path / "cal", {"id": "cal-000001"}, 99)
    files = {"calibrations/cal-000001.json": (tmp_path / "cal").read_bytes()}
    assert "newer vgrd" in refused(spare, sealed(tmp_path, files), SchemaTooNew)


def test_a_calibration_that_is_damaged_though_the_list_agrees_is_refused(spare, tmp_path) -> None:
    refused(spare, sealed(tmp_path, {"calibrations/cal-000001.json": b"{}"}), Corrupt)


def test_a_disk_that_cannot_be_written_is_told(old, tmp_path, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(StoreError, match="free space"):
        old.back_up(tmp_path / "cell.tar")
    assert not (tmp_path / "cell.tar").exists()


def test_a_version_that_does_not_understand_the_calibration_in_use_says_so(old) -> None:
    command = [sys.executable, "-m", "vgrd.store", str(old.state)]
    assert subprocess.run(command, check=False).returncode == 0
    write_document(old.state / "calibrations" / "CURRENT", {"id": "cal-000002", "sha256": ""}, 99)
    said = subprocess.run(command, check=False, capture_output=True, text=True)
    assert said.returncode == 1
    assert "newer vgrd" in said.stderr
    (old.state / "calibrations" / "CURRENT").write_text("damaged")
    assert subprocess.run(command, check=False).returncode == 0
