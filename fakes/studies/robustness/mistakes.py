"""Mistakes of conventions, made on purpose in a clean recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.random import Generator

from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.geometry.rotation_formats import RotationFormat as Format
from vgrd.geometry.rotation_formats import rotation_from, rotation_to
from vgrd.model import (
    Observation,
    Recording,
    TagObservation,
    Target,
    Touch,
    frozen_array,
)

CAMERA_IN_HAND = Pose(exp_rotation((0.1, -0.2, 0.8)), np.array([40.0, -60.0, 70.0]))  # any
Change = Callable[[Recording, Generator], Recording]


@dataclass(frozen=True, slots=True)
class Mistake:
    """code: finding that names it, words: one of them has to stand in its message."""

    change: Change
    code: str
    words: tuple[str, ...] = ()


def with_poses(recording: Recording, change: Callable[[Pose], Pose]) -> Recording:
    """The same session, every reported flange pose changed."""

    def look(observation: Observation) -> Observation:
        return replace(observation, base_from_wrist=change(observation.base_from_wrist))

    return _with_samples(recording, look, change)


def _with_samples(
    recording: Recording,
    look: Callable[[Observation], Observation],
    change: Callable[[Pose], Pose],
) -> Recording:
    def touched(touches: tuple[Touch, ...]) -> tuple[Touch, ...]:
        return tuple(
            replace(
                touch,
                base_from_wrist=change(touch.base_from_wrist),
                observation=touch.observation and look(touch.observation),
            )
            for touch in touches
        )

    return replace(
        recording,
        looks=tuple(look(observation) for observation in recording.looks),
        spins=tuple(look(observation) for observation in recording.spins),
        touches=touched(recording.touches),
        points=touched(recording.points),
    )


def misread(written: Format, read: Format) -> Mistake:
    """Orientations written in one format and read in another."""

    def change(pose: Pose) -> Pose:
        return Pose(rotation_from(rotation_to(pose.rotation, written), read), pose.translation)

    return Mistake(
        lambda recording, _: with_poses(recording, change),
        "rotation_misread",
        (f"numbers read as {read} are taken for {written}",),
    )


def _scaled(factor: float, words: str) -> Mistake:
    return Mistake(
        lambda recording, _: with_poses(
            recording, lambda pose: Pose(pose.rotation, pose.translation * factor)
        ),
        "unit_misread",
        (words,),
    )


def _in_hand(recording: Recording, rng: Generator) -> Recording:
    """What a camera on the flange sees of the same tags, mount stated as fixed."""
    del rng
    table = Pose(exp_rotation((0.0, 0.0, 0.4)), np.array([350.0, 0.0, 0.0]))
    first = recording.touches[0].observation
    if first is None or first.tag_b is None:
        return recording
    still = first.tag_b.camera_from_tag.inverse()

    def change(pose: Pose) -> Pose:
        return pose.inverse()

    def look(observation: Observation) -> Observation:
        wrist = change(observation.base_from_wrist)
        camera_from_tag = (wrist @ CAMERA_IN_HAND).inverse() @ table @ still
        return replace(
            observation,
            base_from_wrist=wrist,
            tag_b=observation.tag_b and _carried(camera_from_tag, observation.tag_b),
        )

    return _with_samples(recording, look, change)


def _carried(motion: Pose, tag: TagObservation) -> TagObservation:
    A = motion.adjoint()
    return replace(
        tag,
        camera_from_tag=motion @ tag.camera_from_tag,
        covariance=frozen_array(A @ tag.covariance @ A.T, 6, 6),
    )


def _with_points(recording: Recording, points: Mapping[str, Array]) -> Recording:
    spec = recording.facts.object
    targets: dict[str, Target] = {
        name: replace(target, point_in_object=frozen_array(points[name], 3))
        for name, target in spec.targets.items()
    }
    spec = replace(spec, targets=MappingProxyType(targets))
    return replace(recording, facts=replace(recording.facts, object=spec))


def _points(recording: Recording) -> dict[str, Array]:
    return {n: t.cad for n, t in recording.facts.object.targets.items()}


def _mirrored(recording: Recording, rng: Generator) -> Recording:
    sign = np.ones(3)
    sign[rng.integers(3)] = -1
    return _with_points(recording, {n: p * sign for n, p in _points(recording).items()})


def _swapped(recording: Recording, rng: Generator) -> Recording:
    points = _points(recording)
    a, b = rng.choice(list(points), 2, replace=False)
    points[a], points[b] = points[b], points[a]
    return _with_points(recording, points)


def _reordered(recording: Recording, rng: Generator) -> Recording:
    points = _points(recording)
    values = list(points.values())
    shift = int(rng.integers(1, len(values)))
    values = values[shift:] + values[:shift]
    if rng.uniform() < 0.5:
        values = values[::-1]
    return _with_points(recording, dict(zip(points, values, strict=True)))


def _smaller_tag(recording: Recording, rng: Generator) -> Recording:
    """Tag A is 1 to 3 % smaller or larger than the file says: it looks farther or nearer."""
    factor = 1 + float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.03))

    def look(observation: Observation) -> Observation:
        tag = observation.tag_a
        if tag is None:
            return observation
        pose = tag.camera_from_tag
        measured = Pose(pose.rotation, pose.translation * factor)
        return replace(observation, tag_a=replace(tag, camera_from_tag=measured))

    return _with_samples(recording, look, lambda pose: pose)


def _stale(recording: Recording, rng: Generator) -> Recording:
    """The pose of one look was not read again for the next."""
    k = int(rng.integers(1, len(recording.looks)))
    looks = list(recording.looks)
    looks[k] = replace(looks[k], base_from_wrist=looks[k - 1].base_from_wrist)
    return replace(recording, looks=tuple(looks))


def _active_tcp(recording: Recording, rng: Generator) -> Recording:
    """The robot reports the pose of a TCP that was active all the time."""
    tcp = Pose(exp_rotation(rng.normal(size=3) * 0.3), rng.uniform(-100, 100, 3))
    return with_poses(recording, lambda pose: pose @ tcp)


def _clean(recording: Recording, rng: Generator) -> Recording:
    del rng
    return recording


_FORMATS = (
    (Format.RPY_FIXED_XYZ_DEG, Format.KUKA_ABC_DEG),
    (Format.KUKA_ABC_DEG, Format.RPY_FIXED_XYZ_DEG),
    (Format.RPY_FIXED_XYZ_DEG, Format.STAUBLI_RXRYRZ_DEG),
    (Format.STAUBLI_RXRYRZ_DEG, Format.KUKA_ABC_DEG),
    (Format.ZYZ_DEG, Format.RPY_FIXED_XYZ_DEG),
    (Format.RPY_FIXED_XYZ, Format.ROTVEC),
    (Format.ROTVEC, Format.RPY_FIXED_XYZ),
    (Format.QUATERNION_WXYZ, Format.QUATERNION_XYZW),
    (Format.RPY_FIXED_XYZ_DEG, Format.RPY_FIXED_XYZ),
    (Format.RPY_FIXED_XYZ, Format.RPY_FIXED_XYZ_DEG),
    (Format.ROTVEC_DEG, Format.ROTVEC),
    (Format.ROTVEC, Format.ROTVEC_DEG),
)
_INVERTED = Mistake(
    lambda recording, _: with_poses(recording, Pose.inverse), "poses_inverted", ("are inverted",)
)
CONVENTIONS: Mapping[str, Mistake] = MappingProxyType(
    {
        **{f"{written} read as {read}": misread(written, read) for written, read in _FORMATS},
        "metres read as mm": _scaled(1e-3, "metres that were read as millimetres"),
        "mm read as metres": _scaled(1e3, "millimetres that were read as metres"),
        "inverted poses": _INVERTED,
        "camera on the flange": Mistake(_in_hand, "mount_wrong", ("mount is eye-in-hand",)),
        "mirrored CAD points": Mistake(_mirrored, "points_mirrored"),
        "two targets swapped": Mistake(_swapped, "targets_swapped"),
        "wrong order of targets": Mistake(_reordered, "points_order"),
    }
)
OTHERS: Mapping[str, Mistake] = MappingProxyType(
    {
        "size of tag A": Mistake(_smaller_tag, "tag_size"),
        "pose not read again": Mistake(_stale, "pose_not_read_again"),
    }
)
UNDECIDABLE: Mapping[str, Mistake] = MappingProxyType(
    {"constant active TCP": Mistake(_active_tcp, "flange_not_proven")}
)
CLEAN = Mistake(_clean, "")
