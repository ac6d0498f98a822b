"""Other readings of a dataset under which its samples agree: formats, mount, units, the order of the pictures."""

import re
from collections.abc import Sequence
from pathlib import Path

from vgrd.calibration.checks import (
    Interpretation,
    Poses,
    agreement,
    best_of,
    mistaken_unit,
)
from vgrd.calibration.hand_eye import flange_motion_of
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.rotation_formats import RotationFormat, pose_from, value_count
from vgrd.judging.thresholds import CONTRADICTORY_DEG, CONTRADICTORY_MM
from vgrd.model import Mount
from vgrd.solving.datasets.loading import Dataset

_CLEARLY_BETTER = 0.6  # of the misfit as read: chance explains less
_SAME_READING_MM = 0.01  # readings that fit as well are all named
_ORDER_FROM = 5  # samples: fewer agree in some order by chance


def suspects(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """What may have been meant instead, in words; empty where no other reading fits."""
    return (
        unit_mismatch(dataset, names, camera_from_target)
        or _readings(dataset, names, camera_from_target)
        or _orders(dataset, names, camera_from_target)
    )


def unit_mismatch(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """Robot and target told in units that differ: the samples agree but for a factor."""
    fit = agreement(_moves(dataset, names), Poses.of(camera_from_target))
    if mistaken_unit(fit) is None or not fit.within(CONTRADICTORY_DEG, CONTRADICTORY_MM):
        return []
    ratio = fit.millimetres
    factor = f"{ratio:.4g}" if ratio > 1 else f"1 / {1 / ratio:.4g}"
    other = "the size of the target or its points" if dataset.camera else "camera_from_target"
    return [
        f"But for the unit of length the samples agree: by {other} one unit of the robot's lengths is "
        f"{factor} of those of the target (1000: metres beside millimetres, 25.4: inches). Write both in one unit."
    ]


def _moves(dataset: Dataset, names: Sequence[str]) -> Poses:
    wrists = {sample.name: sample.base_from_wrist for sample in dataset.samples}
    return Poses.of([flange_motion_of(dataset.mount, wrists[name]) for name in names])


def _orders(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """Poses and pictures paired in another order, such as 1, 10, 11, 2."""
    n = len(names)
    if n < _ORDER_FROM:
        return []
    moves = _moves(dataset, names)
    stated = agreement(moves, Poses.of(camera_from_target))
    files = {s.name: s.source for s in dataset.samples if isinstance(s.source, Path)}
    orders: dict[str, list[int]] = {
        "one picture later": [(i + 1) % n for i in range(n)],
        "one picture earlier": [(i - 1) % n for i in range(n)],
        "in reverse order": list(range(n))[::-1],
    }
    labels = [files[name].stem for name in names] if len(files) == len(dataset.samples) else names
    natural = sorted(range(n), key=lambda i: _natural(labels[i]))
    alphabetical = sorted(range(n), key=lambda i: labels[i])
    # poses in natural order beside pictures in alphabetical order, and the other way round
    orders["in natural order (1, 2, ... 10, 11)"] = natural
    orders["in alphabetical order (1, 10, 11, 2)"] = alphabetical
    orders["with the pictures of 1, 10, 11, 2 counted as 1, 2, 3, 4"] = _inverse(alphabetical)
    fits = {
        words: agreement(moves, Poses.of([camera_from_target[i] for i in order]))
        for words, order in orders.items()
    }
    best = min(fits, key=lambda words: fits[words].mm)
    fit = fits[best]
    if not fit.within(CONTRADICTORY_DEG, CONTRADICTORY_MM):
        return []
    if fit.deg > _CLEARLY_BETTER * stated.deg:
        return []
    return [
        f"Paired {best}, poses and pictures agree to {fit.mm:.1f} mm: were they listed in "
        "another order than they were taken?"
    ]


def _inverse(order: Sequence[int]) -> list[int]:
    return [order.index(i) for i in range(len(order))]


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Sorts numbers in a name by their value."""
    parts = re.findall(r"\d+|\D+", name)
    return [(0, int(p), "") if p.isdigit() else (1, 0, p) for p in parts]


def _readings(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """Other readings of the same numbers (rotation format, mount) under which the samples agree."""
    rows = {s.name: v for s, v in zip(dataset.samples, dataset.pose_values, strict=True)}
    cameras = Poses.of(camera_from_target)
    readings: dict[tuple[RotationFormat, Mount], Interpretation] = {}
    for fmt in RotationFormat:
        if value_count(fmt) != value_count(dataset.rotation):
            continue
        try:
            poses = [pose_from(rows[name], fmt, dataset.unit) for name in names]
        except InputError:
            continue
        for mount in Mount:
            moves = Poses.of([flange_motion_of(mount, pose) for pose in poses])
            other_format = None if fmt is dataset.rotation else fmt
            readings[fmt, mount] = Interpretation(
                moves, meant=other_format, inverted=mount != dataset.mount
            )
    baseline = agreement(readings.pop((dataset.rotation, dataset.mount)).poses, cameras)
    candidates = best_of(
        list(readings.values()),
        lambda moves: agreement(moves, cameras),
        deg=CONTRADICTORY_DEG,
        mm=CONTRADICTORY_MM,
    )
    if not candidates or candidates[0].fit.mm > _CLEARLY_BETTER * baseline.mm:
        return []
    best = candidates[0].fit
    fitting = {
        id(candidate.reading)
        for candidate in candidates
        if candidate.fit.mm < best.mm + _SAME_READING_MM
    }
    alike = [key for key, reading in readings.items() if id(reading) in fitting]
    formats = " or ".join(dict.fromkeys(str(fmt) for fmt, _ in alike))
    mounts = " or ".join(dict.fromkeys(str(mount) for _, mount in alike))
    unit = mistaken_unit(best)
    lengths = f", lengths = {unit}" if unit else ""
    return [
        f"Read as rotation = {formats}, mount = {mounts}{lengths}, the samples agree to "
        f"{best.mm:.1f} mm: is that meant? (The other mount also fits poses that were written "
        "inverted.)"
    ]
