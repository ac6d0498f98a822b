"""Calibrations of the plant, taught without pictures and solved once: what the stores of all machines hold."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory

import numpy as np

from fakes.cell.cell import cell_text
from fakes.cell.rehearsal import NO_CAMERA, NO_ROBOT, Rehearsal
from fakes.world.layout import Layout
from fakes.world.noise import COARSE
from tests.invariant.simulation.plant import SEED, Plant
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.solve import calibrate_system
from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved
from vgrd.config.setup import cell_facts
from vgrd.judging.findings import finding
from vgrd.model import CellFacts, Motion, Observation, Plan, Recording, Verdict
from vgrd.store.calibrations import CalibrationStore

VISION = COARSE.finer(2)  # with less noise answers stand longer, and there is more to be wrong
PORT = 1502


@dataclass(frozen=True, slots=True)
class Variant:
    """What the cell file says of the cell, as far as pictures are judged by it."""

    motion: Motion = Motion.TURNTABLE
    stability: str = "fixed"
    hidden_tag: str = "invalid"

    def __str__(self) -> str:
        return f"{self.motion.value}, {self.stability}, {self.hidden_tag}"


VARIANTS = tuple(
    Variant(motion, stability, hidden)
    for motion in Motion
    for stability in ("fixed", "movable")
    for hidden in ("invalid", "hold")
)


def resolved(variant: Variant, folder: Path) -> Resolved:
    """The cell file of a variant, checked as `vgrd run` checks it; folders are in `folder`."""
    text = cell_text(Layout(), robot=NO_ROBOT, camera=NO_CAMERA, port=PORT)
    for old, new in (
        ('motion = "turntable"', f'motion = "{variant.motion.value}"'),
        ('hidden_tag = "hold"', f'hidden_tag = "{variant.hidden_tag}"'),
        ("rate_hz = 1.0", f'rate_hz = 2.0\nstability = "{variant.stability}"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return Resolved(load_config(path), str(path), 0.0)


class _Lesson(Rehearsal):
    """A rehearsal that sees poses of tags, not pictures."""

    def __init__(self, plant: Plant, facts: CellFacts) -> None:
        self.plant, self.world, self.facts = plant, plant.world, facts
        self.now_s = 0.0
        self._rng = np.random.default_rng((SEED, 5))

    def look(self) -> Observation:
        snapshot, layout = self.world.snapshot(self.now_s), self.world.layout
        camera_from_base = layout.base_from_camera.inverse()
        tag_a, tag_b = (
            VISION.observe(
                self._rng, spec, camera_from_base @ snapshot.base_from_tag(name, layout)
            )
            for name, spec in (("a", layout.tag_a), ("b", layout.tag_b))
        )
        pose = self.world.reported_flange(self.now_s)
        return Observation(pose, self.now_s, tag_a, tag_b)


@cache
def _taught() -> tuple[Recording, ...]:
    """Two sessions of one cell."""
    plant = Plant()
    with TemporaryDirectory() as folder:
        config = resolved(Variant(), Path(folder)).config
    lesson = _Lesson(plant, cell_facts(config, plant.pendant_tcp))
    return tuple(lesson.teach(spins=8, points=0) for _ in range(2))


@cache
def calibrations(motion: Motion) -> tuple[Calibration, ...]:
    """Two calibrations of one cell, of which either is right."""
    return tuple(calibrate_system(_moving(recording, motion)) for recording in _taught())


@cache
def calibration_by(plan: Plan) -> Calibration:
    """One of the same cell by a plan of the paper; the special one has touches with one wrist only."""
    recording = _taught()[0]
    count = len(Layout().targets) if plan is Plan.SPECIAL else len(recording.touches)
    return calibrate_system(replace(recording, plan=plan, touches=recording.touches[:count]))


def _useless(motion: Motion) -> tuple[Calibration, ...]:
    """One that was rejected, and one of another cell."""
    good = calibrations(motion)[0]
    fault = finding("noisy", "made up", fatal=True)
    facts = replace(good.facts, robot_id="another")
    return replace(good, verdict=Verdict((fault,))), replace(good, facts=facts)


class Library:
    """A store with two good calibrations, of which the first is in use, and two useless ones."""

    def __init__(self, motion: Motion) -> None:
        self._folder = TemporaryDirectory()
        store = CalibrationStore(Path(self._folder.name))
        self.names = tuple(store.save(one) for one in (*calibrations(motion), *_useless(motion)))
        store.activate(self.names[0], by="teaching")
        self.by_register_id = {store.read(n).register_id: store.load(n) for n in self.names}

    def copy(self, state: Path) -> None:
        """Fill the state folder of a cell."""
        copytree(self._folder.name, state)


@cache
def library(motion: Motion) -> Library:
    """The one of all machines whose object moves so."""
    return Library(motion)


def _moving(recording: Recording, motion: Motion) -> Recording:
    facts = recording.facts
    return replace(recording, facts=replace(facts, object=replace(facts.object, motion=motion)))
