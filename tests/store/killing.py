"""Kill recorders and savers at random moments and look at what they leave; run by the tests.

usage: killing.py recorder|saver STATE_DIR ROUNDS
Each round forks a child that works as fast as a cell does and tells through a pipe what has been
acknowledged to it.
"""

import itertools
import os
import random
import signal
import sys
import time
from pathlib import Path

from fakes.world.samples import Samples
from vgrd.clock import SystemClock
from vgrd.model import Plan
from vgrd.orphans import die_with
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import (
    SampleKind,
    SessionWriter,
    iterate_flanges,
    iterate_images,
    load_session,
    session_directory,
)

POSES_IN_100_MS = 13
SAMPLES = Samples(7)
FACTS = SAMPLES.facts()
TOUCHES = [SAMPLES.touch() for _ in range(20)]
CALIBRATION = SAMPLES.calibration()


def record(state_dir, name, tell):
    """Poses at 125 Hz, a picture each 13th, a touch each 17th, until killed."""
    clock = SystemClock()
    writer = SessionWriter(state_dir, name, Plan.UNIVERSAL, FACTS, clock)
    image = SAMPLES.image(0.0, 0, 300, 400)
    for i in itertools.count():
        clock.sleep(0.008)
        writer.flange(SAMPLES.flange(clock.monotonic()))
        tell("p")
        if i % 13 == 12:
            writer.image(image)
            tell("i")
        if i % 17 == 16:
            writer.sample(SampleKind.TOUCH, TOUCHES[i % 20])
            tell("t")


def save(state_dir, _name, tell):
    """Save a calibration and put it in use, over and over, until killed."""
    store = CalibrationStore(state_dir)
    while True:
        name = store.save(CALIBRATION)
        tell("s")
        store.activate(name)
        tell("a")


def acknowledged_until_killed(work, seconds):
    """Tell what a child running `work` was told until `seconds` after its first word."""
    reader, writer = os.pipe()
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        die_with(parent)
        try:
            work(lambda word: os.write(writer, word.encode()))
        finally:
            os._exit(1)
    os.close(writer)
    told = os.read(reader, 1)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WTERMSIG(status) == signal.SIGKILL, "the child ended before it was killed"
    while more := os.read(reader, 65536):
        told += more
    os.close(reader)
    return told.decode()


def check_recorder(state_dir, rounds, rng):
    """No touch, at most 100 ms of poses and one picture are lost; recovered files are whole."""
    for i in range(rounds):
        name = f"s{i}"
        told = acknowledged_until_killed(
            lambda tell, name=name: record(state_dir, name, tell), rng.uniform(0.0, 0.7)
        )
        directory = session_directory(state_dir, name)
        live = sum(1 for _ in iterate_flanges(directory))
        session = load_session(directory)
        poses = sum(1 for _ in iterate_flanges(directory))
        images = sum(1 for _ in iterate_images(directory))
        touches = len(session.recording.touches)
        sys.stdout.write(
            f"{name}: lost {told.count('p') - poses} of {told.count('p')} poses, "
            f"{told.count('i') - images} of {told.count('i')} pictures, "
            f"{told.count('t') - touches} of {told.count('t')} touches\n"
        )
        assert touches >= told.count("t")
        assert poses == live >= told.count("p") - POSES_IN_100_MS
        assert images >= told.count("i") - 1
        assert not list(directory.glob("*.open"))
        assert list(directory.glob("*.damaged"))


def check_saver(state_dir, rounds, rng):
    """Every calibration and CURRENT is readable, and nothing that was acknowledged is gone."""
    store = CalibrationStore(state_dir)
    names, current, logged = (), 0, 0
    for _ in range(rounds):
        told = acknowledged_until_killed(
            lambda tell: save(state_dir, "", tell), rng.uniform(0.0, 0.1)
        )
        new = store.list()[len(names) :]
        assert len(new) >= told.count("s")
        assert [store.load(name).id for name in new] == list(new)
        if told.count("a"):
            current = max(current, len(names) + told.count("a"))
        names += new
        serving = int(store.current().id.removeprefix("cal-")) if current else 0
        assert serving >= current
        assert len(store.activations()) >= logged + told.count("a")
        current, logged = serving, len(store.activations())
    sys.stdout.write(f"{rounds} kills, {len(names)} saved, {logged} activated, none lost\n")


if __name__ == "__main__":
    check = {"recorder": check_recorder, "saver": check_saver}[sys.argv[1]]
    check(Path(sys.argv[2]), int(sys.argv[3]), random.Random(11))
