"""Solvers that are given their input as another machine would have it: other last digits, other order.

`python -m pytest --perturb SEED` puts a wrapper around every function of `DOORS`, wherever it is
bound. The outermost door that a call passes multiplies lengths by 1 + 1e-12 N(0, 1), turns poses by
1e-12 rad N(0, 1) and shuffles samples; what a result tells sample by sample is put back in order.
Equal input is perturbed alike, so that two calls can still be compared.
"""

import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, is_dataclass, replace
from functools import singledispatchmethod, wraps
from inspect import Signature, signature
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.hand_eye import (
    HandEyeProblem,
    PosePair,
    PoseSample,
    RecordingProblem,
)
from vgrd.calibration.joint import HolePixel
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import UniversalProblem
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import Observation, Recording, TagObservation, Touch

SIZE = 1e-12  # above rounding of one operation (1e-16), below all that matters to a solver (1e-9)
PACKAGES = ("vgrd", "fakes", "tests", "test_")
Order = NDArray[np.intp]

# Function, and its parameters whose samples belong together. Their order tells these functions
# nothing but a sample's number in a message and where the robot stands last; tests that expect
# either are marked `ordered`. What a session's time tells stands in the stamps of its pictures.
DOORS: Mapping[str, tuple[str, ...]] = {
    "vgrd.calibration.touches.cad_fit:fit_cad": ("points_in_object", "touches"),
    "fakes.studies.paper.baselines:compare_methods": ("recording",),
    "vgrd.calibration.checks:bad_touches": ("recording",),
    "vgrd.calibration.checks:examine": ("recording",),
    "vgrd.calibration.checks:missing_motion": ("recording",),
    "vgrd.calibration.checks:missing_motions": ("recording",),
    "vgrd.calibration.planning.next_sample:next_best": ("taught",),
    "vgrd.calibration.planning.next_sample:rank_samples": ("taught",),
    "vgrd.calibration.hand_eye.pose_pairs:calibrate_hand_eye": ("problem",),
    "vgrd.calibration.hand_eye.published.registry:PublishedMethod.solve": ("pairs",),
    "vgrd.calibration.hand_eye.recording:calibrate_recording": ("problem",),
    "vgrd.calibration.hand_eye.certificate:certified_start": ("flange_motions", "cameras"),
    "vgrd.calibration.hand_eye.certificate:rotation_cost": ("flange_motions", "cameras"),
    "vgrd.calibration.hand_eye.park_martin:park_martin_start": ("flange_motions", "cameras"),
    "vgrd.calibration.joint.estimate:calibrate_joint": ("recording", "sightings"),
    "vgrd.calibration.joint.samples:gather": ("recording", "sightings"),
    "vgrd.calibration.turntable.rotation_center:find_rotation_center": (
        "camera_from_tag",
        "covariances",
    ),
    "vgrd.calibration.stepwise.hole_center:find_hole_center": ("recording", "sightings"),
    "vgrd.calibration.planning.advice:advise_session": ("recording",),
    "vgrd.calibration.solve:calibrate_system": ("recording", "sightings"),
    "vgrd.calibration.tcp.fixed_point:calibrate_fixed_point": ("touches",),
    "vgrd.calibration.tcp.plane:calibrate_plane": ("touches",),
    "vgrd.calibration.tcp.sphere:calibrate_sphere": ("touches",),
    "vgrd.calibration.universal.estimate:calibrate_universal": ("problem",),
    "vgrd.calibration.universal.start:reduced_cost": ("points_in_object", "touches"),
    "vgrd.geometry.covariance:mean_pose": ("poses", "covariances"),
    "vgrd.geometry.resection:pose_from_points": ("points_in_target", "pixels"),
}
_EXACT = ("covariances", "targets")  # sigmas and names go with their samples, as they are
_BY_SAMPLE = ("residuals_mm", "whitened", "scores", "samples", "looks")  # of results


@dataclass(slots=True)
class Perturbation:
    """What `--perturb SEED` does; calls: how often each door was passed. keep_order: no shuffling."""

    seed: int
    keep_order: bool = False
    calls: dict[str, int] = field(default_factory=dict)
    _inside: threading.local = field(default_factory=threading.local)

    def call(
        self, name: str, function: Callable[..., Any], form: Signature, *args: Any, **options: Any
    ) -> Any:
        """The function's result for perturbed arguments; called as it is from within another door."""
        if getattr(self._inside, "door", None):
            return function(*args, **options)
        self._inside.door = name
        try:
            bound = form.bind(*args, **options)
            back = self._change(bound.arguments, DOORS[name])
            self.calls[name] = self.calls.get(name, 0) + 1
            return _restored(function(*bound.args, **bound.kwargs), back)
        finally:
            self._inside.door = None

    def _change(self, arguments: dict[str, Any], names: Sequence[str]) -> Order | None:
        """Perturb the arguments in place; the order that puts results back, None for recordings."""
        filled = [name for name in names if arguments.get(name) is not None]
        if not filled:
            return None
        jitter = Jitter(np.random.default_rng(self.seed), self.keep_order)
        if isinstance(arguments[filled[0]], Recording):
            recording, sightings = arguments[filled[0]], arguments.get("sightings", ())
            arguments[filled[0]], hole_pixels = jitter.session(recording, sightings)
            if "sightings" in filled:
                arguments["sightings"] = hole_pixels
            return None
        if filled == ["taught"]:
            return None  # a result: the recording was perturbed when it was solved
        counts = {_count(arguments[name]) for name in filled}
        if len(counts) != 1:
            return None  # the solver is about to refuse them
        order = jitter.order(counts.pop())
        for name in filled:
            value = arguments[name]
            if name not in _EXACT:
                value = jitter.shaken(value)
            arguments[name] = _taken(value, order)
        return np.argsort(order)


@dataclass(slots=True)
class Jitter:
    """Noise for one call."""

    rng: np.random.Generator
    keep_order: bool = False

    def order(self, count: int) -> Order:
        """A shuffled order of so many samples."""
        return np.arange(count) if self.keep_order else self.rng.permutation(count)

    @singledispatchmethod
    def shaken(self, value: Any) -> Any:
        """The same value, its lengths and rotations changed in the last digits."""
        raise TypeError(f"no rule perturbs {type(value).__name__}")

    @shaken.register
    def _(self, value: np.ndarray) -> Array:
        numbers = np.asarray(value, dtype=np.float64)
        return np.asarray(numbers * (1 + SIZE * self.rng.normal(size=numbers.shape)))

    @shaken.register
    def _(self, value: list | tuple) -> Any:  # type: ignore[type-arg]
        if all(isinstance(item, int | float) for item in value):
            return self.shaken(np.array(value))
        return [self.shaken(item) for item in value]

    @shaken.register
    def _(self, value: Pose) -> Pose:
        turn = exp_rotation(SIZE * self.rng.normal(size=3))
        return Pose(turn @ value.rotation, self.shaken(value.translation))

    @shaken.register
    def _(self, value: TouchSet) -> TouchSet:
        turns = np.array([exp_rotation(SIZE * self.rng.normal(size=3)) for _ in range(len(value))])
        return replace(
            value,
            rotations=turns.reshape(-1, 3, 3) @ value.rotations,
            translations=self.shaken(value.translations),
        )

    @shaken.register
    def _(self, value: UniversalProblem) -> UniversalProblem:
        points = self.shaken(np.asarray(value.points_in_object))
        return UniversalProblem(points, self.shaken(value.touches))

    @shaken.register
    def _(self, value: HandEyeProblem) -> HandEyeProblem:
        return replace(value, samples=[self.shaken(sample) for sample in value.samples])

    @shaken.register
    def _(self, value: RecordingProblem) -> RecordingProblem:
        return replace(value, wrists=[self.shaken(wrist) for wrist in value.wrists])

    @shaken.register
    def _(self, value: PoseSample | PosePair) -> Any:
        return replace(
            value,
            base_from_wrist=self.shaken(value.base_from_wrist),
            camera_from_target=self.shaken(value.camera_from_target),
        )

    @shaken.register
    def _(self, value: Touch) -> Touch:
        observation = value.observation
        return replace(
            value,
            base_from_wrist=self.shaken(value.base_from_wrist),
            observation=None if observation is None else self.shaken(observation),
        )

    @shaken.register
    def _(self, value: Observation) -> Observation:
        a, b = value.tag_a, value.tag_b
        return replace(
            value,
            base_from_wrist=self.shaken(value.base_from_wrist),
            tag_a=None if a is None else self.shaken(a),
            tag_b=None if b is None else self.shaken(b),
        )

    @shaken.register
    def _(self, value: TagObservation) -> TagObservation:
        return replace(value, camera_from_tag=self.shaken(value.camera_from_tag))

    @shaken.register
    def _(self, value: HolePixel) -> HolePixel:
        return replace(value, pixel=self.shaken(value.pixel))

    def session(
        self, recording: Recording, sightings: Sequence[HolePixel]
    ) -> tuple[Recording, tuple[HolePixel, ...]]:
        """A recording and the holes seen in it; each hole still tells of its spin."""
        kinds = ("looks", "spins", "touches", "points", "verifications")
        orders: dict[str, Order] = {}
        samples: dict[str, Any] = {}
        for kind in kinds:  # verifications last: what is held out changes no other's noise
            originals = getattr(recording, kind)
            orders[kind] = self.order(len(originals))
            samples[kind] = tuple(
                self.shaken(sample) for sample in _taken(originals, orders[kind])
            )
        place = np.argsort(orders["spins"])
        hole_pixels = _taken(
            [self.shaken(sample) for sample in sightings], self.order(len(sightings))
        )
        holes = (
            sample if sample.spin is None else _with_spin(sample, place) for sample in hole_pixels
        )
        return replace(recording, **samples), tuple(holes)


def _with_spin(hole: HolePixel, place: Order) -> HolePixel:
    is_known = hole.spin is not None and 0 <= hole.spin < len(place)
    return replace(hole, spin=int(place[hole.spin])) if is_known else hole


def _count(value: Any) -> int:
    if isinstance(value, UniversalProblem):
        return len(value.touches)
    if isinstance(value, RecordingProblem):
        return len(value.names)
    return len(value.samples if hasattr(value, "samples") else value)


def _taken(value: Any, order: Order) -> Any:
    """The samples of a value in that order."""
    if isinstance(value, np.ndarray):
        return value[order]
    if isinstance(value, TouchSet):
        return value.subset(order)
    if isinstance(value, UniversalProblem):
        return UniversalProblem(value.points_in_object[order], value.touches.subset(order))
    if isinstance(value, HandEyeProblem):
        return replace(value, samples=[value.samples[i] for i in order])
    if isinstance(value, RecordingProblem):
        return value.chosen([int(i) for i in order])
    return [value[i] for i in order]


def _restored(result: Any, back: Order | None) -> Any:
    """The result, sample by sample in the order in which they were given."""
    if back is None or not is_dataclass(result) or isinstance(result, type):
        return result
    if hasattr(
        result, "result"
    ):  # a result within a result: of hand-eye that is determined in part
        return replace(result, result=_restored(result.result, back))
    values = {name: getattr(result, name, None) for name in _BY_SAMPLE}
    columns = {name: value for name, value in values.items() if value is not None}
    changed = {
        name: value[back] if isinstance(value, np.ndarray) else tuple(value[i] for i in back)
        for name, value in columns.items()
        if len(value) == len(back)
    }
    return replace(result, **changed)


@contextmanager
def installed(perturbation: Perturbation) -> Iterator[Perturbation]:
    """All doors perturb, in modules already imported and in those to come, until the end."""
    bindings: list[tuple[Any, str, Any]] = []
    for name in DOORS:
        owner, _, attribute = name.rpartition(":")[2].rpartition(".")
        home = resolve_name(f"{name.partition(':')[0]}:{owner}")
        function = getattr(home, attribute)
        door = _door(perturbation, name, function)
        modules = [module for key, module in sys.modules.items() if key.startswith(PACKAGES)]
        for place in (home, *modules):
            for key in [key for key, value in vars(place).items() if value is function]:
                bindings.append((place, key, function))
                setattr(place, key, door)
    try:
        yield perturbation
    finally:
        for place, key, function in bindings:
            setattr(place, key, function)


def _door(
    perturbation: Perturbation, name: str, function: Callable[..., Any]
) -> Callable[..., Any]:
    form = signature(function)

    @wraps(function)
    def call(*args: Any, **options: Any) -> Any:
        return perturbation.call(name, function, form, *args, **options)

    return call
