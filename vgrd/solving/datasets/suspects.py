"""Other readings of a dataset under which its samples agree: formats, mount, units, the order of the pictures."""

import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from vgrd.calibration.checks import (
    Agreement,
    Interpretation,
    Poses,
    agreement,
    best_of,
    mistaken_unit,
)
from vgrd.calibration.hand_eye import flange_motion_of
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.pose_formats import MATRIX, MATRIX_COLUMNS
from vgrd.geometry.rotation_formats import (
    RotationFormat,
    pose_from,
    rotation_from,
    rotation_to,
    value_count,
)
from vgrd.judging.thresholds import CONTRADICTORY_DEG, CONTRADICTORY_MM
from vgrd.model import Mount
from vgrd.solving.datasets.loading import Dataset

_CLEARLY_BETTER = 0.6  # of the misfit as read: chance explains less
_SAME_READING_MM = 0.01  # readings that fit as well are all named
_ORDER_FROM = 5  # samples: fewer agree in some order by chance
_OTHER_UNIT = 1.5  # between lengths: no arm, lens or print is so far off
_OTHER_UNIT_FITS = 0.1  # of the misfit with the unit as written
_QUATERNION = 4  # numbers
_NEAR = 1.1  # to a usual factor: what a print is off beside it
_FACTORS: Mapping[float, str] = {
    1000.0: "metres beside millimetres",
    25.4: "inches beside millimetres",
    10.0: "centimetres beside millimetres",
}


def suspects(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """What may have been meant instead, in words; empty where no other reading fits, or the one as written."""
    mismatch = unit_mismatch(dataset, names, camera_from_target)
    if mismatch or _agree(dataset, names, camera_from_target):
        return mismatch
    return _readings(dataset, names, camera_from_target) or _orders(
        dataset, names, camera_from_target
    )


def unit_mismatch(
    dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]
) -> list[str]:
    """Robot and target told in units that differ: the samples agree but for a factor."""
    moves, cameras = _moves(dataset, names), Poses.of(camera_from_target)
    fit = agreement(moves, cameras)
    ratio = fit.millimetres
    if ratio <= 0 or 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        return []
    # misfits are lengths of the target: where these are told too large, so are the misfits
    if fit.deg > CONTRADICTORY_DEG or fit.mm / max(1.0, ratio) > CONTRADICTORY_MM:
        return []
    if fit.mm > _OTHER_UNIT_FITS * agreement(moves, cameras, unit_known=True).mm:
        return []
    factor = f"{ratio:.4g}" if ratio > 1 else f"1 / {1 / ratio:.4g}"
    other = "the size of the target or its points" if dataset.camera else "camera_from_target"
    return [
        f"But for the unit of length the samples agree: by {other} one unit of the robot's lengths is "
        f"{factor} of those of the target ({_factor_in_words(ratio)}). Write both in one unit."
    ]


def _factor_in_words(ratio: float) -> str:
    larger = max(ratio, 1 / ratio)
    for factor, words in _FACTORS.items():
        if 1 / _NEAR < larger / factor < _NEAR:
            return words
    return "no usual factor: measure the target too"


def _agree(dataset: Dataset, names: Sequence[str], camera_from_target: Sequence[Pose]) -> bool:
    """Whether the samples agree as they are written: what failed then has another cause."""
    cameras = Poses.of(camera_from_target)
    stated = agreement(_moves(dataset, names), cameras, unit_known=True)
    return stated.within(CONTRADICTORY_DEG, CONTRADICTORY_MM)


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
    if fit.deg > _CLEARLY_BETTER * stated.deg or fit.mm > _CLEARLY_BETTER * stated.mm:
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
    """Other readings of the same numbers (rotation formats, mount) under which the samples agree."""
    written = Poses.of(camera_from_target)
    moves = _robot_readings(dataset, names)
    stated = (dataset.rotation, dataset.mount)
    baseline = _misfit(agreement(moves[stated].poses, written))
    for camera_format, cameras in _camera_readings(dataset, written).items():
        is_written = camera_format == dataset.camera_format
        tried = {key: move for key, move in moves.items() if key != stated or not is_written}
        candidates = best_of(
            list(tried.values()),
            partial(agreement, cameras=cameras),
            deg=CONTRADICTORY_DEG,
            mm=CONTRADICTORY_MM,
        )
        if not candidates or _misfit(candidates[0].fit) > _CLEARLY_BETTER * baseline:
            continue
        best = candidates[0].fit
        fitting = {
            id(candidate.reading)
            for candidate in candidates
            if candidate.fit.mm < best.mm + _SAME_READING_MM
        }
        alike = [key for key, reading in tried.items() if id(reading) in fitting]
        return [_in_words(dataset, alike, "" if is_written else camera_format, best)]
    return []


def _misfit(fit: Agreement) -> float:
    """Of turns and places together: either may fit alone under a wrong reading."""
    return fit.deg / CONTRADICTORY_DEG + fit.mm / CONTRADICTORY_MM


def _robot_readings(
    dataset: Dataset, names: Sequence[str]
) -> dict[tuple[RotationFormat, Mount], Interpretation]:
    """The robot's numbers in every format of as many, for both mounts; of matrices there is one."""
    rows = {s.name: v for s, v in zip(dataset.samples, dataset.pose_values, strict=True)}
    is_matrix = dataset.pose_format in (MATRIX, MATRIX_COLUMNS)
    readings: dict[tuple[RotationFormat, Mount], Interpretation] = {}
    for fmt in RotationFormat:
        is_written = fmt is dataset.rotation
        if value_count(fmt) != value_count(dataset.rotation) or (is_matrix and not is_written):
            continue
        try:
            poses = [pose_from(rows[name], fmt, dataset.unit) for name in names]
        except InputError:
            continue
        for mount in Mount:
            moves = Poses.of([flange_motion_of(mount, pose) for pose in poses])
            other_format = None if is_written else fmt
            readings[fmt, mount] = Interpretation(
                moves, meant=other_format, inverted=mount != dataset.mount
            )
    return readings


def _camera_readings(dataset: Dataset, written: Poses) -> dict[str, Poses]:
    """The camera's poses as written, and quaternions in the other order."""
    readings = {dataset.camera_format: written}
    if dataset.camera_format not in tuple(RotationFormat):
        return readings
    stated = RotationFormat(dataset.camera_format)
    if value_count(stated) == _QUATERNION:
        numbers = [rotation_to(R, stated) for R in written.rotations]
        for fmt in (RotationFormat.QUATERNION_WXYZ, RotationFormat.QUATERNION_XYZW):
            turns = np.array([rotation_from(values, fmt) for values in numbers])
            readings.setdefault(str(fmt), Poses(turns, written.translations))
    return readings


def _in_words(
    dataset: Dataset,
    alike: Sequence[tuple[RotationFormat, Mount]],
    camera_format: str,
    best: Agreement,
) -> str:
    """camera_format: of the camera's poses where it is another than written, else ""."""
    is_matrix = dataset.pose_format in (MATRIX, MATRIX_COLUMNS)
    formats = [dataset.pose_format if is_matrix else str(fmt) for fmt, _ in alike]
    rotation = " or ".join(dict.fromkeys(formats))
    mounts = list(dict.fromkeys(str(mount) for _, mount in alike))
    camera = f", camera_poses.rotation = {camera_format}" if camera_format else ""
    unit = mistaken_unit(best)
    lengths = f", lengths = {unit}" if unit else ""
    words = (
        f"Read as rotation = {rotation}, mount = {' or '.join(mounts)}{camera}{lengths}, the samples "
        f"agree to {best.mm:.1f} mm: is that meant?"
    )
    if mounts == [str(dataset.mount)]:
        return words
    sides = "base_from_wrist as wrist_from_base"
    if dataset.camera is None:
        sides += ", or camera_from_target as target_from_camera"
    return f"{words} (They agree as well if one side was written inverted: {sides}.)"
