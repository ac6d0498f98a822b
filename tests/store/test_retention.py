"""Old sessions give way to new ones, and none that is needed ever does."""

import os
import re
import shutil
from dataclasses import replace

import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.errors import StoreError
from vgrd.model import Plan
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.retention import in_use, make_room, used_bytes
from vgrd.store.sessions import (
    SampleKind,
    SessionWriter,
    list_sessions,
    load_session,
    session_directory,
)

SIZE = 1_000_000


def record(state_dir, name, size=SIZE, *, keep_open=False):
    """A session of so many bytes."""
    facts = Samples(1).facts()
    writer = SessionWriter(state_dir, name, Plan.UNIVERSAL, facts, ManualClock())
    (writer.path / "000.mcap").write_bytes(bytes(size))
    if not keep_open:
        writer.close()
    return writer


@pytest.fixture
def state(tmp_path):
    """Six sessions, a to f, oldest first."""
    for number, name in enumerate("abcdef"):
        writer = record(tmp_path, name)
        os.utime(writer.path / "session.json", (1e9 + number, 1e9 + number))
    return tmp_path


def cite(state_dir, session):
    calibration = replace(Samples(2).calibration(), session=session)
    CalibrationStore(state_dir).save(calibration)


def test_nothing_is_removed_below_the_quota(state):
    room = make_room(state, 7 * SIZE)
    assert (room.removed, room.trouble) == ((), "")
    assert room.used_bytes == sum(used_bytes(state).values()) > 6 * SIZE


def test_the_oldest_go_first_and_no_more_than_needed(state):
    assert make_room(state, 4 * SIZE + SIZE // 2).removed == ("a", "b")
    assert list_sessions(state) == ("c", "d", "e", "f")
    assert sorted(path.name for path in (state / "sessions").iterdir()) == ["c", "d", "e", "f"]


def test_what_a_calibration_cites_is_never_removed(state):
    cite(state, "a")
    cite(state, "c")
    room = make_room(state, 3 * SIZE)
    assert room.removed == ("b", "d")
    assert list_sessions(state) == ("a", "c", "e", "f")
    assert "all are needed: raise [recording] quota_gb" in room.trouble
    assert make_room(state, 3 * SIZE).removed == ()


def test_the_open_session_and_the_newest_two_are_never_removed(state):
    os.utime(state / "sessions" / "f" / "session.json", (1e9 - 1, 1e9 - 1))
    with record(state, "open", keep_open=True) as writer:
        os.utime(writer.path / "session.json", (1e9 - 2, 1e9 - 2))
        assert list_sessions(state) == ("open", "f", "a", "b", "c", "d", "e")
        assert make_room(state, 1).removed == ("f", "a", "b", "c")
        assert list_sessions(state) == ("open", "d", "e")
        writer.sample(SampleKind.TOUCH, Samples(1).touch())
    assert len(load_session(writer.path).recording.touches) == 1


def test_a_session_that_is_being_solved_is_left_alone(state):
    with in_use(session_directory(state, "a")), in_use(session_directory(state, "a")):
        assert make_room(state, 1).removed == ("b", "c", "d")
    assert make_room(state, 1).removed == ("a",)


def test_nothing_is_removed_while_a_calibration_cannot_be_read(state):
    cite(state, "a")
    path = state / "calibrations" / "cal-000001.json"
    path.write_bytes(path.read_bytes().replace(b'"session": "a"', b'"session": "b"'))
    room = make_room(state, 1)
    assert re.search(r"no session is removed.*cal-000001\.json: the checksum", room.trouble)
    assert room.removed == ()
    assert list_sessions(state) == tuple("abcdef")


def test_a_removal_that_was_cut_short_is_finished_and_its_rest_is_no_session(state):
    (state / "sessions" / "a").rename(state / "sessions" / ".removed-a")
    assert list_sessions(state) == tuple("bcdef")
    assert make_room(state, 100 * SIZE).removed == ()
    assert not (state / "sessions" / ".removed-a").exists()


def test_a_folder_that_cannot_be_removed_is_named(state, monkeypatch):
    def refuse(path):
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr("shutil.rmtree", refuse)
    cannot = r"cannot remove .*\.removed-a.*make it writable"
    room = make_room(state, 5 * SIZE)
    assert re.search(cannot, room.trouble)
    assert room.removed == ("a",)
    assert list_sessions(state) == tuple("bcdef")
    with pytest.raises(StoreError, match=cannot):
        make_room(state, 5 * SIZE)


def test_what_was_removed_before_a_fault_is_told(state, monkeypatch):
    real, removed = shutil.rmtree, []

    def refuse_the_third(path):
        removed.append(path)
        if len(removed) == 3:
            raise OSError(5, "Input/output error", str(path))
        real(path)

    monkeypatch.setattr("shutil.rmtree", refuse_the_third)
    room = make_room(state, 1)
    assert room.removed == ("a", "b", "c")
    assert "Input/output error" in room.trouble
    assert make_room(state, 1).removed == ("d",)
