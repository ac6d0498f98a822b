"""Record until the disk (here: the largest file allowed) is full; run by the tests.

usage: full_disk.py STATE_DIR
"""

import resource
import sys
from pathlib import Path

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.errors import StoreError
from vgrd.model import Plan
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import SampleKind, SessionWriter, iterate_flanges, load_session


def limit_files(size):
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard if size is None else size, hard))


def refusal(call, *arguments):
    """Return the words of the StoreError that the call raises."""
    try:
        call(*arguments)
    except StoreError as error:
        return str(error)
    raise AssertionError("nothing was refused")


def fill(writer, samples, clock):
    """Record poses until the disk refuses; how many were taken and why no more."""
    for i in range(10_000):
        clock.sleep(0.008)
        try:
            writer.flange(samples.flange(clock.monotonic()))
        except StoreError as error:
            return i, str(error)
    raise AssertionError("the disk never was full")


def check_session(state_dir):
    samples, clock = Samples(1), ManualClock()
    writer = SessionWriter(state_dir, "s1", Plan.UNIVERSAL, samples.facts(), clock)
    limit_files(200_000)
    taken, reason = fill(writer, samples, clock)
    assert str(writer.path) in reason, reason
    assert "raise the limit of the file size" in reason, reason
    assert refusal(writer.flange, samples.flange(1.0)) == reason
    touched = writer.sample(SampleKind.TOUCH, samples.touch())
    limit_files((writer.path / "samples.jsonl").stat().st_size + 100)
    assert "samples.jsonl" in refusal(writer.sample, SampleKind.TOUCH, samples.touch())
    limit_files(None)
    assert writer.sample(SampleKind.TOUCH, samples.touch()) == touched + 1
    writer.close()
    session = load_session(writer.path)
    assert session.warnings == ()
    assert len(session.recording.touches) == 2
    assert sum(1 for _ in iterate_flanges(writer.path)) >= taken - 13


def check_calibrations(state_dir):
    store, calibration = CalibrationStore(state_dir), Samples(2).calibration()
    store.activate(store.save(calibration))
    limit_files(1000)
    assert "cal-000002.json" in refusal(store.save, calibration)
    limit_files(100)
    assert "activations.jsonl" in refusal(store.activate, "cal-000001")
    limit_files(None)
    assert store.list() == ("cal-000001",)
    assert store.current().id == "cal-000001"
    assert len(store.activations()) == 1
    assert not list(store.path.glob("*.tmp"))


if __name__ == "__main__":
    check_session(Path(sys.argv[1]))
    check_calibrations(Path(sys.argv[1]))
