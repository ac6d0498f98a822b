"""A session comes back as it was taught, whatever happened to the process or the disk."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.clock import SystemClock
from vgrd.errors import Corrupt, InputError, SchemaTooNew, StoreError
from vgrd.model import Plan
from vgrd.orphans import dying_with_us
from vgrd.store.encoding import encode
from vgrd.store.files import read_document, write_document
from vgrd.store.journal import Journal, read_journal
from vgrd.store.recovery import read_messages
from vgrd.store.sessions import (
    SCHEMA,
    SampleKind,
    SessionWriter,
    iterate_flanges,
    iterate_images,
    iterate_observations,
    list_sessions,
    load_recording,
    load_session,
)
from vgrd.store.topics import Topic

POSES = 300
IMAGES = (100, 200)


@pytest.fixture
def clock():
    return ManualClock()


def new_session(state_dir, clock, name="s1", samples=None):
    return SessionWriter(state_dir, name, Plan.UNIVERSAL, (samples or Samples(1)).facts(), clock)


def flange_times(path):
    """Unix times, ns, of the poses that can be read; their content is not decoded."""
    (segment,) = (p for p in path.iterdir() if p.suffix in (".mcap", ".open"))
    return [message.time_ns for message in read_messages(segment, frozenset({Topic.FLANGE}))]


def same(a, b):
    return encode(a) == encode(b)


@pytest.fixture
def taught(tmp_path, clock):
    """Record a session: its folder, and the poses, the pictures and the observation in it."""
    samples = Samples(2)
    poses, images = [], []
    with new_session(tmp_path, clock, samples=samples) as writer:
        for i in range(POSES):
            clock.sleep(0.008)
            poses.append(samples.flange(clock.monotonic()))
            writer.flange(poses[-1])
            if i in IMAGES:
                images.append(samples.image(clock.monotonic(), i))
                assert writer.image(images[-1])
        observation = samples.observation()
        writer.observation(observation)
    return writer.path, poses, images, observation


def test_a_recording_holds_what_was_taught_in_order_and_without_what_was_undone(tmp_path, clock):
    samples = Samples(3)
    taught = [
        (SampleKind.LOOK, samples.observation()),
        (SampleKind.LOOK, samples.observation()),
        (SampleKind.TOUCH, samples.touch("P1")),
        (SampleKind.TOUCH, samples.touch("P2")),
        (SampleKind.POINT, samples.touch("pin")),
        (SampleKind.SPIN, samples.observation()),
        (SampleKind.VERIFY, samples.touch("P3")),
    ]
    with new_session(tmp_path, clock) as writer:
        assert [writer.sample(*sample) for sample in taught] == [1, 2, 3, 4, 5, 6, 7]
        assert writer.undo()[:2] == (7, SampleKind.VERIFY)
        assert writer.undo()[:2] == (6, SampleKind.SPIN)
        assert writer.sample(SampleKind.VERIFY, taught[-1][1]) == 10
        assert writer.counts == {"look": 2, "touch": 2, "point": 1, "verify": 1}
        live = load_recording(writer.path)
    recording = load_recording(writer.path)
    assert same(recording, live)
    assert (recording.session, recording.plan) == ("s1", Plan.UNIVERSAL)
    assert same(recording.facts, Samples(1).facts())
    assert same(recording.looks, [taught[0][1], taught[1][1]])
    assert same(recording.touches, [taught[2][1], taught[3][1]])
    assert same(recording.points, [taught[4][1]])
    assert recording.spins == ()
    assert same(recording.verifications, [taught[6][1]])


def test_any_sample_is_undone_by_its_number_and_a_touch_gets_the_name_that_was_meant(
    tmp_path, clock
):
    """Both stay in the file as lines of their own: what was recorded is never changed."""
    samples = Samples(3)
    touches = [samples.touch(name) for name in ("P1", "P2", "P3")]
    with new_session(tmp_path, clock) as writer:
        writer.sample(SampleKind.LOOK, samples.observation())
        for touch in touches:
            writer.sample(SampleKind.TOUCH, touch, by_foot=True)
        assert writer.undo_sample(3).value is touches[1]
        assert writer.retag(4, "P1").value.target == "P1"
        assert writer.touched == {"P1": 2}
        for number in (3, 9):
            with pytest.raises(InputError, match=rf"no sample {number}: .* has 1 to 2, 4"):
                writer.undo_sample(number)
        with pytest.raises(InputError, match="sample 1 is a look: only a touch"):
            writer.retag(1, "P2")
        with pytest.raises(InputError, match="of P1 already"):
            writer.retag(4, "P1")
        live = load_recording(writer.path)
    session = load_session(writer.path)
    assert same(session.recording, live)
    assert [touch.target for touch in live.touches] == ["P1", "P1"]
    assert same(live.touches[1].base_from_wrist, touches[2].base_from_wrist)
    assert session.numbers[SampleKind.TOUCH] == (2, 4)
    assert session.last_by_foot == "P1"  # of the first one: the other was named by somebody
    lines = read_journal(writer.path / "samples.jsonl").records
    assert [line["kind"] for line in lines] == ["look", *["touch"] * 3, "undo", "retag"]


def test_a_name_for_a_sample_that_is_no_touch_is_corrupt(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        writer.sample(SampleKind.LOOK, Samples(3).observation())
    journal = Journal(writer.path / "samples.jsonl")
    journal.append({"kind": "retag", "value": 1, "target": "P1"})
    journal.close()
    with pytest.raises(Corrupt, match="line 2: names the target of sample 1"):
        load_session(writer.path)


def test_harvested_samples_are_told_apart_and_undone_apart(tmp_path, clock):
    samples = Samples(3)
    looks = [samples.observation() for _ in range(4)]
    with new_session(tmp_path, clock) as writer:
        writer.sample(SampleKind.LOOK, looks[0])
        for look in looks[1:]:
            writer.sample(SampleKind.LOOK, look, harvested=True)
        writer.sample(SampleKind.TOUCH, samples.touch())
        assert writer.harvested == {"look": 3}
        writer.give_back([looks[1], looks[0].tag_b])
        assert writer.undo(harvested=True)[:2] == (4, SampleKind.LOOK)
        assert writer.undo(SampleKind.LOOK)[:2] == (3, SampleKind.LOOK)
        assert writer.undo(harvested=False)[:2] == (5, SampleKind.TOUCH)
        with pytest.raises(InputError, match="no sample has been harvested"):
            writer.undo(harvested=True)
        writer.sample(SampleKind.SPIN, looks[2], harvested=True)
        assert load_session(writer.path).harvested == writer.harvested == {"spin": 1}
    session = load_session(writer.path)
    assert session.harvested == {"spin": 1}
    assert same(session.recording.looks, looks[:1])
    assert same(session.recording.spins, looks[2:3])


def test_a_reader_that_knows_no_mark_takes_a_harvested_sample_for_one_asked_for(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        writer.sample(SampleKind.LOOK, Samples(3).observation(), harvested=True)
    (record,) = read_journal(writer.path / "samples.jsonl").records
    assert record.pop("harvested") is True
    assert set(record) == {"kind", "value"}  # what all versions read


def test_poses_pictures_and_observations_come_back_to_the_last_bit(taught):
    path, poses, images, observation = taught
    assert same(list(iterate_flanges(path)), poses)
    assert same(list(iterate_observations(path)), [observation])
    for found, image in zip(iterate_images(path), images, strict=True):
        assert (found.frame, found.stamp_s) == (image.frame, image.stamp_s)
        assert found.pixels.dtype == image.pixels.dtype
        assert np.array_equal(found.pixels, image.pixels)


def test_sixteen_bit_pictures_come_back_to_the_last_bit(tmp_path, clock):
    image = Samples(4).image(1.0, 1)
    deep = type(image)(image.pixels.astype(np.uint16) * 257, 1.0, 1)
    with new_session(tmp_path, clock) as writer:
        writer.image(deep)
    (found,) = iterate_images(writer.path)
    assert found.pixels.dtype == np.uint16
    assert np.array_equal(found.pixels, deep.pixels)


def test_any_mcap_tool_opens_a_closed_segment(taught):
    path, poses, images, _ = taught
    with (path / "000.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = [
            (schema and schema.name, channel.topic)
            for schema, channel, _ in reader.iter_messages()
        ]
    assert summary.statistics.message_count == len(poses) + len(images) + 1
    assert found.count(("foxglove.PoseInFrame", "/flange")) == len(poses)
    assert found.count((None, "/image")) == len(images)
    assert found.count(("vgrd.Observation", "/observation")) == 1


def test_no_pose_waits_longer_than_100_ms_in_memory(tmp_path, clock):
    samples = Samples(5)
    with new_session(tmp_path, clock) as writer:
        for i in range(1, 101):
            clock.sleep(0.008)
            writer.flange(samples.flange(clock.monotonic()))
            assert len(flange_times(writer.path)) >= i - 12
        clock.sleep(0.1)
        writer.tick()
        assert len(flange_times(writer.path)) == 100


def test_a_picture_is_in_the_file_when_the_call_returns(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        writer.image(Samples(6).image(clock.monotonic(), 1))
        assert len(list(iterate_images(writer.path))) == 1


def test_a_new_segment_begins_each_minute(tmp_path, clock):
    samples = Samples(7)
    with new_session(tmp_path, clock) as writer:
        for _ in range(150):
            clock.sleep(1.0)
            writer.flange(samples.flange(clock.monotonic()))
    assert [p.name for p in sorted(writer.path.glob("*.mcap*"))] == [
        f"{i:03d}.mcap" for i in range(3)
    ]
    stamps = [reading.stamp_s for reading in iterate_flanges(writer.path)]
    assert stamps == sorted(stamps)
    assert len(stamps) == 150


def test_a_session_is_never_overwritten(taught, clock):
    path, *_ = taught
    before = {p: p.read_bytes() for p in path.iterdir()}
    with pytest.raises(StoreError, match=r"'s1' exists already.*choose another name"):
        new_session(path.parents[1], clock)
    assert {p: p.read_bytes() for p in path.iterdir()} == before


@pytest.mark.parametrize("name", ["", "../s1", "a/b", ".hidden", "a b", "x" * 81])
def test_a_session_name_is_a_plain_file_name(tmp_path, clock, name):
    with pytest.raises(InputError, match="session name"):
        new_session(tmp_path, clock, name)
    assert list(tmp_path.iterdir()) == []


def test_sessions_are_listed_oldest_first(tmp_path, clock):
    for name in ("b", "a", "c"):
        new_session(tmp_path, clock, name).close()
    assert list_sessions(tmp_path) == ("b", "a", "c")


def test_a_closed_session_takes_nothing_more(tmp_path, clock):
    writer = new_session(tmp_path, clock)
    writer.close()
    writer.close()
    with pytest.raises(StoreError, match="closed"):
        writer.sample(SampleKind.TOUCH, Samples(1).touch())
    with pytest.raises(StoreError, match="closed"):
        writer.flange(Samples(1).flange(1.0))
    assert not list(writer.path.glob("*.open"))


def test_a_sample_of_the_wrong_kind_and_an_empty_undo_are_refused(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        with pytest.raises(InputError, match="a look is a Observation"):
            writer.sample(SampleKind.LOOK, Samples(1).touch())
        with pytest.raises(InputError, match="nothing to undo"):
            writer.undo()


@pytest.fixture
def samples_file(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        for i in range(5):
            writer.sample(SampleKind.TOUCH, Samples(i).touch(f"P{i}"))
    return writer.path / "samples.jsonl"


def test_a_torn_last_line_of_a_session_that_a_kill_ended_is_left_out_with_a_warning(samples_file):
    (samples_file.parent / "closed.json").unlink()
    whole = samples_file.read_bytes()
    last = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(last + 1, len(whole), 97):
        samples_file.write_bytes(whole[:cut])
        session = load_session(samples_file.parent)
        assert len(session.recording.touches) == 4
        assert "line 5 was cut short" in session.warnings[0]


def test_a_flipped_bit_in_an_acknowledged_sample_is_corrupt_naming_file_and_line(samples_file):
    rng = np.random.default_rng(8)
    whole = samples_file.read_bytes()
    for _ in range(100):
        at = int(rng.integers(len(whole) - 1))
        flipped = bytearray(whole)
        flipped[at] ^= 1 << int(rng.integers(8))
        samples_file.write_bytes(flipped)
        line = min(whole[: at + 1].count(b"\n") + (whole[at] != 10), 5)
        with pytest.raises(Corrupt, match=rf"samples\.jsonl, line {line}:"):
            load_recording(samples_file.parent)


def test_a_lost_line_is_corrupt(samples_file):
    lines = samples_file.read_bytes().splitlines(keepends=True)
    samples_file.write_bytes(b"".join(lines[:2] + lines[3:]))
    with pytest.raises(Corrupt, match="line 3:"):
        load_recording(samples_file.parent)


@pytest.mark.parametrize("left", [0, 1, 4])
def test_lines_that_a_closed_session_has_lost_are_told(samples_file, left):
    lines = samples_file.read_bytes().splitlines(keepends=True)
    samples_file.write_bytes(b"".join(lines[:left]))
    with pytest.raises(Corrupt, match=rf"has {left} lines.*closed with 5.*restore"):
        load_recording(samples_file.parent)
    samples_file.unlink()
    with pytest.raises(Corrupt, match="has 0 lines"):
        load_recording(samples_file.parent)


def test_a_flipped_bit_in_the_facts_is_corrupt_and_a_newer_schema_is_told(samples_file):
    path = samples_file.parent / "session.json"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"36h11", b"36h10", 1))
    with pytest.raises(Corrupt, match=r"session\.json: the checksum is wrong"):
        load_recording(path.parent)
    path.write_bytes(whole)
    write_document(path, read_document(path, SCHEMA), SCHEMA + 1)
    with pytest.raises(SchemaTooNew, match=r"session\.json: schema \d+.*update vgrd"):
        load_recording(path.parent)


def test_what_is_no_session_is_told_so(tmp_path):
    with pytest.raises(StoreError, match="is not a session"):
        load_recording(tmp_path)


def test_a_flipped_bit_costs_at_most_the_chunk_it_is_in(taught):
    path, *_ = taught
    segment = path / "000.mcap"
    whole = segment.read_bytes()
    times = flange_times(path)
    rng = np.random.default_rng(9)
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        segment.write_bytes(damaged)
        left = flange_times(path)
        assert len(times) - len(left) <= 13
        assert set(left) <= set(times)
        lost_images = len(IMAGES) - sum(1 for _ in iterate_images(path))
        assert lost_images + (left != times) <= 1


def test_a_segment_cut_anywhere_is_recovered_up_to_there(taught):
    path, poses, *_ = taught
    whole = (path / "000.mcap").read_bytes()
    (path / "000.mcap").unlink()
    torn = path / "000.mcap.open"
    counts = []
    for cut in np.linspace(0, len(whole), 25, dtype=int):
        garbage = np.random.default_rng(cut).bytes(300)
        torn.write_bytes(whole[:cut] + garbage)
        assert load_session(path).warnings == ()
        assert (path / "000.mcap.damaged").read_bytes() == whole[:cut] + garbage
        with (path / "000.mcap").open("rb") as file:
            readable = sum(
                1 for _ in make_reader(file, validate_crcs=True).iter_messages(topics="/flange")
            )
        assert readable == len(flange_times(path))
        counts.append(readable)
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, len(poses))
    steps = np.diff(counts)
    assert steps.max() <= 60


def test_a_session_that_is_being_recorded_is_not_recovered(tmp_path, clock):
    with new_session(tmp_path, clock) as writer:
        writer.image(Samples(6).image(clock.monotonic(), 1))
        assert load_session(writer.path).warnings == ()
        assert (writer.path / "000.mcap.open").exists()
    assert not (writer.path / "000.mcap.open").exists()


def test_an_unrecoverable_segment_is_a_warning_not_a_lost_session(samples_file):
    (samples_file.parent / "000.mcap.open").mkdir()
    session = load_session(samples_file.parent)
    assert len(session.recording.touches) == 5
    assert "cannot" in session.warnings[0]


def run_child(script, *arguments):
    result = subprocess.run(
        dying_with_us([sys.executable, str(script), *map(str, arguments)]),
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_kills_lose_no_touch_100_ms_of_poses_and_one_picture(tmp_path):
    run_child(Path(__file__).with_name("killing.py"), "recorder", tmp_path, 5)


def test_a_full_disk_stops_the_recording_with_the_remedy_and_loses_nothing_written(tmp_path):
    run_child(Path(__file__).with_name("full_disk.py"), tmp_path)


def test_a_state_folder_that_cannot_be_made_is_named_with_the_remedy(tmp_path):
    (tmp_path / "state").write_text("a file")
    with pytest.raises(StoreError, match=r"cannot create .*state.*a part of it is a file"):
        new_session(tmp_path / "state", SystemClock())
