"""Which convention was mistaken: rotation format, degrees, unit of length, inverted poses, mount.

The recorded poses are read in every other way; the reading under which robot and pictures agree to
what the noise allows is named. What no reading can show is told by `cannot_tell`.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vgrd.calibration.checks.interpretations import (
    Fitted,
    Interpretation,
    best_of,
    degrees_as_radians,
    other_readings,
)
from vgrd.calibration.checks.pose_agreement import Agreement, Poses, agreement, noise_of
from vgrd.calibration.hand_eye import PoseSample, hand_eye_samples
from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CONTRADICTORY_DEG, CONTRADICTORY_MM, REACH_MM
from vgrd.model import CellFacts, Finding, Mount, Recording, Stability

_MIN_SAMPLES = 4  # three fit every convention
_SIGMAS = 6.0  # of the typical noise: good files are never doubted
_LEAST_DEG = 0.5  # no convention is so small a mistake
_LEAST_MM = 2.0  # the same
_UNIT_RATIO = 1.3  # the tag's size may be wrong by so much and the unit is still told
_UNITS: Mapping[float, str] = MappingProxyType(  # mm that a unit measures
    {
        1000.0: "metres that were read as millimetres",
        0.001: "millimetres that were read as metres",
        25.4: "inches that were read as millimetres",
    }
)
_MOVES_ALONG = 0.3  # of the wrist's way: a camera on the flange sees tag B move so
_TURNED_DEG = 2.0  # turns that tell the mount
_SHIFTED_MM = 20.0  # ways that tell the mount


def misinterpreted_poses(
    recording: Recording, *, read_as: RotationFormat | None = None
) -> Finding | None:
    """The mistake in the robot's poses with which they fit the pictures of tag A; None without one.

    read_as: the format in which the driver reads them, None where that is not known. Fewer than 4
    distinct poses, or none that turned, tell nothing.
    """
    samples = hand_eye_samples(recording)
    if len(samples) < _MIN_SAMPLES:
        return None
    wrists = Poses.of([sample.base_from_wrist for sample in samples])
    cameras = Poses.of([sample.camera_from_target for sample in samples])
    flange_motions = wrists if recording.facts.mount is Mount.EYE_TO_HAND else wrists.inverted()
    deg, mm = _limits(samples, cameras, recording.facts.robot_sigma_mm)
    stated = agreement(flange_motions, cameras)
    if stated.within(deg, mm):
        return _unit_finding(stated, flange_motions, cameras, mm)
    fitting = explain(flange_motions, cameras, deg=deg, mm=mm, read_as=read_as)
    if fitting:
        return _finding(fitting, stated, recording)
    if stated.within(CONTRADICTORY_DEG, CONTRADICTORY_MM):
        return None
    return finding(
        "poses_contradict",
        f"robot poses and pictures of tag A contradict each other, typically {stated.deg:.1f} deg and "
        f"{stated.mm:.1f} mm off, whatever rotation format, unit or mount is supposed",
        fatal=True,
    )


def explain(
    flange_motions: Poses,
    cameras: Poses,
    *,
    deg: float,
    mm: float,
    read_as: RotationFormat | None = None,
) -> list[Fitted]:
    """Readings of moves (n) under which they agree with the pictures, the likeliest first.

    The search for degrees that were read as radians is made when nothing else agrees.
    """

    def fit(poses: Poses) -> Agreement:
        return agreement(poses, cameras)

    for readings in (
        other_readings(flange_motions, cameras, deg=deg, read_as=read_as),
        degrees_as_radians(flange_motions, cameras, mm=mm),
    ):
        fitting = best_of(list(readings), fit, deg=deg, mm=mm)
        if fitting:
            return fitting
    return []


def cannot_tell(facts: CellFacts) -> tuple[Finding, ...]:
    """What no recording can show, so that nobody reads its silence as a proof.

    A TCP or user frame that stays active shifts all flange poses alike: hand-eye, TCP and object
    take it up and every residual is the same to the last digit.
    """
    if facts.wrist_from_tcp is None:
        return (
            finding(
                "flange_not_proven",
                "whether the robot reports its flange or an active TCP cannot be told from the "
                "samples, and this robot does not tell it",
            ),
        )
    return ()


def _limits(samples: Sequence[PoseSample], cameras: Poses, sigma_mm: float) -> tuple[float, float]:
    """Medians, degrees and mm, that noise does not explain."""
    covariances = np.array([sample.covariance for sample in samples])
    noise = noise_of(cameras, covariances, sigma_mm, sigma_mm / REACH_MM)
    return (
        max(_LEAST_DEG, _SIGMAS * float(np.degrees(noise.rad))),
        max(_LEAST_MM, _SIGMAS * noise.mm),
    )


def mistaken_unit(fit: Agreement) -> str | None:
    """In words what the robot's lengths are, where one unit of them is far from the stated one."""
    for millimetres, words in _UNITS.items():
        if 1 / _UNIT_RATIO < fit.millimetres / millimetres < _UNIT_RATIO:
            return words
    return None


def _unit_finding(
    stated: Agreement, flange_motions: Poses, cameras: Poses, mm: float
) -> Finding | None:
    """A wrong unit is a scale of about 1000 that the pictures insist on."""
    words = mistaken_unit(stated)
    if words is None or agreement(flange_motions, cameras, unit_known=True).within(np.inf, mm):
        return None
    return finding(
        "unit_misread",
        f"by the size of tag A one unit of the robot's positions measures {stated.millimetres:.4g} mm "
        f"instead of 1, they are {words}",
        fatal=True,
    )


def _finding(fitting: Sequence[Fitted], stated: Agreement, recording: Recording) -> Finding:
    """Name the likeliest reading and those that fit as well."""
    best = fitting[0]
    simplest = [
        candidate for candidate in fitting if candidate.reading.faults == best.reading.faults
    ]
    words = list(dict.fromkeys(_words(candidate.reading, recording) for candidate in simplest))
    unit = mistaken_unit(best.fit)
    also = f" and lengths are {unit}" if unit else ""
    message = (
        f"as recorded, robot poses and pictures of tag A are typically {stated.deg:.1f} deg and "
        f"{stated.mm:.1f} mm off; they agree to {best.fit.deg:.2f} deg and {best.fit.mm:.2f} mm when "
        f"{' or '.join(words)}{also}"
    )
    return finding(_code(best.reading, recording), message, fatal=True)


def _code(reading: Interpretation, recording: Recording) -> str:
    if reading.meant is not None:
        return "rotation_misread"
    flange_motions = _camera_moves(recording)
    if flange_motions is None:
        return "poses_inverted_or_mount"
    return "mount_wrong" if flange_motions else "poses_inverted"


def _words(reading: Interpretation, recording: Recording) -> str:
    parts = []
    if reading.meant is not None:
        parts.append(f"numbers read as {reading.read_as} are taken for {reading.meant}")
    if reading.inverted:
        flange_motions = _camera_moves(recording)
        mounts = [mount for mount in Mount if mount is not recording.facts.mount]
        other = f"the camera's mount is {mounts[0]}"
        poses = "poses are inverted (base seen from the flange)"
        parts.append(
            f"{poses} or {other}" if flange_motions is None else other if flange_motions else poses
        )
    return " and ".join(parts)


def _camera_moves(recording: Recording) -> bool | None:
    """Whether the mount is another one than stated, by tag B on the object that stands still.

    A camera that stands still sees it stand still. None where too little was seen of it, and of a
    camera that people move.
    """
    if recording.facts.camera_stability is Stability.MOVABLE:
        return None
    pairs = [
        (picture.base_from_wrist, picture.tag_b.camera_from_tag)
        for picture in recording.touch_pictures
        if picture.tag_b
    ]
    if len(pairs) < 2:
        return None
    wrists, tags = (Poses.of([pair[k] for pair in pairs]) for k in (0, 1))
    travel_mm = float(np.ptp(wrists.translations, axis=0).max())
    shift_mm = float(np.ptp(tags.translations, axis=0).max())
    turn_rad = np.max([pairs[0][0].distance(wrist)[1] for wrist, _ in pairs])
    if travel_mm < _SHIFTED_MM and np.degrees(turn_rad) < _TURNED_DEG:
        return None
    follows = shift_mm > max(_LEAST_MM, _MOVES_ALONG * travel_mm * (travel_mm >= _SHIFTED_MM))
    return bool(follows) == (recording.facts.mount is Mount.EYE_TO_HAND)
