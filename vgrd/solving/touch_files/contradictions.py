"""Why touches of a file contradict each other: read otherwise than written, targets mixed up, something moved."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from vgrd.calibration.checks import (
    DISTINCT_FORMATS,
    Jump,
    VariedWrists,
    find_jump,
    misinterpretation,
)
from vgrd.calibration.observability import noise_scale
from vgrd.calibration.tcp import TouchRows, by_kind, touch_kinds
from vgrd.errors import CalibrationError, InputError
from vgrd.geometry import Array
from vgrd.geometry.covariance import radius95
from vgrd.geometry.rotation_formats import rotation_from, rotation_to, value_count
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import NOISY_SCALE, TOUCHES_CONTRADICT_MM
from vgrd.model import Finding
from vgrd.solving.touch_files.document import TouchFile, TouchKind
from vgrd.solving.touch_files.fitting import Levelled, plain_fit, rows_of
from vgrd.solving.touch_files.stated_surfaces import find_stated_off
from vgrd.solving.touch_files.wrong_targets import find_wrong_target

_ENOUGH = 150  # touches show a mistake in all of them: more would cost time only
_MOST_TARGETS = 40  # of which every pair is exchanged: 780 fits
_FITS = 3.0  # times the promised scatter, as of targets that are mixed up
_CLEARLY_BETTER = 0.3  # of the scatter as written: chance does not explain a third
_FAR_BETTER = 0.1  # of it: that is the reading, however rough the touches are
_RIVAL = 0.5  # of the next best reading: else both are named
_UNITS: Mapping[float, str] = MappingProxyType(
    {1000.0: "metres", 25.4: "inches", 10.0: "centimetres", 1e-3: "micrometres"}
)
_FACTORS = (0.8, 1.25)  # no part and no arm is off by more: a unit is meant
_LEAST_FREEDOM = 3  # below it some reading fits by chance
_TURN = rotation_from([0.3, -0.5, 0.7], DISTINCT_FORMATS[0])  # any turn tells formats apart
_TOUCHED: Mapping[TouchKind, str] = MappingProxyType(
    {
        TouchKind.UNIVERSAL: "the object",
        TouchKind.FIXED_POINT: "the point",
        TouchKind.PLANE: "the plane",
        TouchKind.SPHERE: "the ball",
    }
)


def find_contradiction(file: TouchFile, levelled: Levelled, *, noisy: bool) -> Finding | None:
    """Why the touches contradict each other; None where they do not. noisy: more than was stated."""
    used = levelled.estimate.fit.used
    doubtful = noisy or not used.all()
    some = file.subset(_evenly(len(file.names), _ENOUGH))
    mistake = (misread(some) or scaled(some) or _mixed_up(some)) if doubtful else None
    mistake = (
        mistake or _moved(some, noisy=noisy) or find_wrong_target(some) or find_stated_off(file)
    )
    if mistake:
        return mistake
    rms = levelled.rms_mm
    if noisy and levelled.stated_scale > NOISY_SCALE and rms > TOUCHES_CONTRADICT_MM:
        radius = radius95(levelled.estimate.covariance)
        message = (
            f"the touches contradict each other, {rms:.1f} mm rms; by that the tip would be known to "
            f"{radius:.1f} mm at 95 %"
        )
        return finding("touches_contradict", message, fatal=True)
    return None


def misread(file: TouchFile) -> Finding | None:
    """The way to read the orientations in which the touches fit, where it is not the one written."""
    stated = _scale(file)
    tried = sorted(
        ((_scale(reading), words) for words, reading in _readings(file)), key=lambda pair: pair[0]
    )
    if not tried or not tried[0][0] < _CLEARLY_BETTER * stated:
        return None
    best = tried[0][0]
    if best > _FITS and not (np.isfinite(stated) and best <= _FAR_BETTER * stated):
        return None
    words = [words for scale, words in tried if _RIVAL * scale <= best]
    fit = f"{stated:.0f} times" if np.isfinite(stated) else "far beyond"
    written = "matrices" if file.by_matrix else file.rotation_format
    return finding(
        "rotations_misread",
        f"read as {written} the touches contradict each other, {fit} what their sigma "
        f"promises; they agree, {best:.1f} times, when {' or '.join(words)}",
        fatal=True,
    )


def _readings(file: TouchFile) -> Iterator[tuple[str, TouchFile]]:
    """The file with its orientations read in every other format, and with inverted poses.

    Inverted poses swap the TCP and a fixed point or the centre of a ball, and the touches of that fit as before.
    """
    t = file.touches.translations
    R = file.touches.rotations
    told = file.kind in (TouchKind.UNIVERSAL, TouchKind.PLANE)
    if told:
        words = "the poses are inverted (base seen from the flange)"
        yield words, file.with_poses(*_inverted(R, t))
    if file.by_matrix:  # which nobody can read in two ways
        return
    written = rotation_to(_TURN, file.rotation_format)
    for meant in DISTINCT_FORMATS:
        same_count = value_count(meant) == value_count(file.rotation_format)
        if not same_count or np.array_equal(rotation_to(_TURN, meant), written):
            continue
        try:
            R = np.array([rotation_from(numbers, meant) for numbers in file.rotations])
        except InputError:
            continue
        words = f'rotation = "{meant}"'
        yield words, file.with_poses(R, t)
        if told:
            yield f"{words} and the poses are inverted", file.with_poses(*_inverted(R, t))


def _inverted(R: Array, t: Array) -> tuple[Array, Array]:
    back = np.swapaxes(R, 1, 2)
    return back, -np.einsum("mij,mj->mi", back, t)


def _scale(file: TouchFile) -> float:
    """How many times as much as promised the touches scatter; infinite where they determine nothing."""
    try:
        fit = plain_fit(file)
    except CalibrationError:
        return float("inf")
    return noise_scale(fit) if fit.degrees_of_freedom >= _LEAST_FREEDOM else float("inf")


def scaled(file: TouchFile) -> Finding | None:
    """CAD points in another unit, or longer or shorter than the touches by one factor."""
    if file.kind is not TouchKind.UNIVERSAL:
        return None

    def scale_at(factor: float) -> float:
        return _scale(replace(file, points_in_object=file.points_in_object * factor))

    clearly = _CLEARLY_BETTER * _scale(file)
    best, factor = min((scale_at(unit), unit) for unit in _UNITS)
    words = f"the targets are in {_UNITS[factor]}"
    if not best < clearly:
        nearest = minimize_scalar(
            scale_at, bounds=_FACTORS, method="bounded", options={"xatol": 1e-5}
        )
        best, factor = float(nearest.fun), float(nearest.x)
        words = "CAD, part or arm is off in scale"
    if not best < clearly or best > _FITS:
        return None
    return finding(
        "targets_scaled",
        f"the touches fit when the targets are {factor:.5g} times as far apart, {best:.1f} times what their sigma "
        f"promises: {words}",
        fatal=True,
    )


def _mixed_up(file: TouchFile) -> Finding | None:
    """Targets that are exchanged, mirrored or in another order."""
    if file.kind is not TouchKind.UNIVERSAL:
        return None
    if len(np.unique(file.points_in_object, axis=0)) > _MOST_TARGETS:
        file = file.subset(_evenly(len(file.names), _MOST_TARGETS))
    wrists = VariedWrists(file.touches)
    return misinterpretation(file.names, file.points_in_object, wrists, _scale(file))


def _moved(file: TouchFile, *, noisy: bool) -> Finding | None:
    """What was touched moved between two touches."""
    kinds = touch_kinds(file.touches, np.array(file.sigma_given))
    moved = file

    def relinearize(shifts: Array) -> TouchRows:
        nonlocal moved
        moved = file.with_poses(file.touches.rotations, file.touches.translations - shifts)
        return by_kind(rows_of(moved, plain_fit(moved)), kinds)

    sigma = max(kind.stated_mm for kind in kinds)
    try:
        jump = find_jump(relinearize, kinds, len(file.names), sigma, is_noisy=noisy)
        if jump is None:
            return None
        tcp = plain_fit(moved).tcp_in_wrist
    except CalibrationError:
        return None
    return finding("reference_moved", _moved_words(file, jump, tcp), fatal=True)


def _moved_words(file: TouchFile, jump: Jump, tcp: Array) -> str:
    names = [repr(name) for name in file.names]
    x, y, z = jump.shift_in_base
    return (
        f"{_TOUCHED[file.kind]} moved {jump.length_mm:.1f} mm ({x:.1f}, {y:.1f}, {z:.1f}) between touch "
        f"{names[jump.first - 1]} and {names[jump.first]}: touches {_span(names[: jump.first])} "
        f"belong together, and {_span(names[jump.first :])}; each taken so, the TCP is "
        f"({tcp[0]:.1f}, {tcp[1]:.1f}, {tcp[2]:.1f})"
    )


def _span(names: list[str]) -> str:
    return f"{names[0]} to {names[-1]}" if len(names) > 2 else " and ".join(names)


def _evenly(count: int, most: int) -> NDArray[np.intp]:
    """Indices of at most so many touches."""
    return np.unique(np.linspace(0, count - 1, most).astype(int))
