"""Other ways to read recorded poses: rotation formats mixed up, degrees for radians, inverted.

A pose that was read in a wrong format still holds the numbers that were written: they are
recovered with the format they were read in and read again in another one.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from vgrd.calibration.checks.pose_agreement import Agreement, Poses, from_positions
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.geometry.rotation_formats import RotationFormat as Format
from vgrd.geometry.rotation_formats import rotation_from, rotation_to, value_count

DISTINCT_FORMATS = (  # those that write different numbers
    Format.RPY_FIXED_XYZ,
    Format.RPY_FIXED_XYZ_DEG,
    Format.KUKA_ABC_DEG,
    Format.STAUBLI_RXRYRZ_DEG,
    Format.ZYZ_DEG,
    Format.ROTVEC,
    Format.ROTVEC_DEG,
    Format.QUATERNION_WXYZ,
    Format.QUATERNION_XYZW,
)
_DEGREES_OF = {Format.RPY_FIXED_XYZ: Format.RPY_FIXED_XYZ_DEG, Format.ROTVEC: Format.ROTVEC_DEG}
_MOST_DEG = 180.0  # a rotation vector longer than that is written otherwise
_CLOSE_RAD = 0.35  # 20 degrees: what unwinding must reach before a fit decides
_CHECKED = 6  # poses that decide about lost turns
_SIFTED = 6  # poses that rule a format out, spread over all
_LOOSE = 3.0  # times the limit, for so few poses
_ALIKE = 1.5  # times the best: readings that fit as well are all named


@dataclass(frozen=True, slots=True, eq=False)
class Interpretation:
    """Poses as they may have been meant; read_as, meant: formats, None where nothing was mixed up."""

    poses: Poses
    read_as: Format | None = None
    meant: Format | None = None
    inverted: bool = False

    @property
    def faults(self) -> int:
        """How many mistakes it supposes."""
        return (self.meant is not None) + self.inverted


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A reading and how well the samples agree under it."""

    reading: Interpretation
    fit: Agreement


def other_readings(
    poses: Poses, cameras: Poses, *, deg: float, read_as: Format | None = None
) -> Iterator[Interpretation]:
    """Readings with one format taken for another, inverted or not, and inverted alone.

    Only those under which robot and target turn by the same angles, median within `deg`.
    read_as: the format the poses were read in; None where that is not known.
    """
    turns = Turns(cameras.rotations)
    if turns.off_deg(poses.rotations) <= deg:
        yield Interpretation(poses.inverted(), inverted=True)
    few = np.unique(np.linspace(0, len(poses) - 1, _SIFTED).astype(int))
    sieve = Turns(cameras.rotations[few])
    for read, meant in product(DISTINCT_FORMATS, DISTINCT_FORMATS):
        if read == meant or value_count(read) != value_count(meant):
            continue
        if read_as is not None and read != _same_as(read_as):
            continue
        sifted = sieve.chosen(reread_candidates(poses.rotations[few], read, meant))
        if not any(sieve.off_deg(R) <= _LOOSE * deg for R in sifted):
            continue
        for R in turns.chosen(reread_candidates(poses.rotations, read, meant)):
            if turns.off_deg(R) <= deg:
                again = Poses(R, poses.translations)
                yield Interpretation(again, read, meant)
                yield Interpretation(again.inverted(), read, meant, inverted=True)


class Turns:
    """By which angles the target turned between the pictures (n, 3, 3)."""

    def __init__(self, rotations: Array) -> None:
        self._rotations = rotations
        self._steps = _step_angles(rotations)

    def off_deg(self, rotations: Array) -> float:
        """How far the angles of a robot (n, 3, 3) are off, degrees: median."""
        return float(np.degrees(np.median(np.abs(_step_angles(rotations) - self._steps))))

    def chosen(self, candidates: Sequence[Array]) -> Iterator[Array]:
        """Rotations (n, 3, 3), of the candidates (k, 3, 3) of each pose those that turn alike."""
        if not all(len(rotations) for rotations in candidates):
            return
        angles = _angles(self._rotations @ self._rotations[0].T)
        for first in candidates[0]:
            yield np.array(
                [
                    rotations[np.argmin(np.abs(_angles(rotations @ first.T) - angle))]
                    for rotations, angle in zip(candidates, angles, strict=True)
                ]
            )


def _step_angles(R: Array) -> Array:
    shifts = range(1, min(4, len(R)))
    return np.concatenate([_angles(R @ np.swapaxes(np.roll(R, k, axis=0), 1, 2)) for k in shifts])


def _angles(R: Array) -> Array:
    """Angles (n,), rad, of rotations (n, 3, 3)."""
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))


def reread_candidates(rotations: Array, read: Format, meant: Format) -> list[Array]:
    """For each rotation the (k, 3, 3) that `meant` makes of the numbers it may have been written as."""
    candidates = []
    for R in rotations:
        numbers = _all_numbers(rotation_to(R, read), read)
        try:
            candidates.append(np.array([rotation_from(values, meant) for values in numbers]))
        except InputError:
            candidates.append(np.zeros((0, 3, 3)))
    return candidates


def _all_numbers(numbers: Array, fmt: Format) -> list[Array]:
    """All numbers within a turn that `fmt` takes for the same rotation."""
    half = 180.0 if fmt.endswith("deg") else np.pi
    if value_count(fmt) == 4:
        return [numbers]
    if fmt in (Format.ROTVEC, Format.ROTVEC_DEG):
        angle = float(np.linalg.norm(numbers))
        return [numbers, numbers * (1 - 2 * half / angle)] if angle > 0 else [numbers]
    a, b, c = numbers
    other = np.array([a + half, -b if fmt is Format.ZYZ_DEG else half - b, c + half])
    return [numbers, (other + half) % (2 * half) - half]


def _same_as(fmt: Format) -> Format:
    """The first of the formats that write the same numbers."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    numbers = rotation_to(turn, fmt)
    alike = [f for f in DISTINCT_FORMATS if np.array_equal(rotation_to(turn, f), numbers)]
    return alike[0]


def best_of(
    readings: Sequence[Interpretation],
    fit: Callable[[Poses], Agreement],
    *,
    deg: float,
    mm: float,
) -> list[Fitted]:
    """Readings under which the samples agree within the limits, the likeliest first.

    Those that agree about as well as the best one follow it, fewer mistakes first.
    """
    fitted = [Fitted(reading, fit(reading.poses)) for reading in readings]
    good = [
        candidate
        for candidate in fitted
        if candidate.fit.within(deg, mm) and candidate.fit.millimetres > 0
    ]
    if not good:
        return []

    def misfit(candidate: Fitted) -> float:
        return candidate.fit.deg / deg + candidate.fit.mm / mm

    limit = _ALIKE * min(misfit(candidate) for candidate in good)
    alike = [candidate for candidate in good if misfit(candidate) <= limit]
    return sorted(alike, key=lambda candidate: (candidate.reading.faults, misfit(candidate)))


def degrees_as_radians(poses: Poses, cameras: Poses, *, mm: float) -> Iterator[Interpretation]:
    """Readings of degrees that were taken for radians: whole turns are lost and sought again.

    Flange positions and pictures tell all rotations but a constant one; each number of the first
    pose may lack any number of turns, and the choice with which the other poses come out as they
    were recorded is taken. Positions that do not fit within `mm` allow no search.
    """
    if len(poses) < _CHECKED:
        return
    R_X, _, median_mm = from_positions(poses.translations, cameras)
    if median_mm > mm:
        return
    rotations = R_X @ cameras.rotations
    for read, meant in _DEGREES_OF.items():
        first = _unwound(poses.rotations[0], read)
        constant = rotations[0].T @ _matrices(first, meant)
        for i in range(1, _CHECKED):
            again = _matrices(_numbers(rotations[i] @ constant, meant), read)
            residuals_rad = _angles(again @ poses.rotations[i].T)
            is_close = residuals_rad < _CLOSE_RAD
            constant, residuals_rad = constant[is_close], residuals_rad[is_close]
            if not len(constant):
                break
        else:
            best = constant[np.argmin(residuals_rad)]
            yield Interpretation(Poses(rotations @ best, poses.translations), read, meant)


def _unwound(rotation: Array, read: Format) -> Array:
    """Numbers (k, 3) in degrees that give this rotation when taken for radians."""
    numbers = rotation_to(rotation, read)
    turns = np.arange(-29, 30) * 2 * np.pi
    if read is Format.ROTVEC:
        angle = max(float(np.linalg.norm(numbers)), 1e-12)
        lengths = angle + turns
        lengths = lengths[np.abs(lengths) <= _MOST_DEG]
        return np.asarray(lengths[:, None] * numbers / angle)
    x, y, z = numbers
    vectors = []
    for a, b, c in ((x, y, z), (x + np.pi, np.pi - y, z + np.pi)):
        sides = [a + turns, b + turns, c + turns]
        sides = [s[np.abs(s) <= most] for s, most in zip(sides, (180.0, 90.0, 180.0), strict=True)]
        vectors.append(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3))
    return np.concatenate(vectors)


def _matrices(numbers: Array, fmt: Format) -> Array:
    """Rotations (k, 3, 3) of many numbers (k, 3) in one of the four formats of the search."""
    degrees = fmt in _DEGREES_OF.values()
    if fmt in (Format.ROTVEC, Format.ROTVEC_DEG):
        return Rotation.from_rotvec(numbers, degrees=degrees).as_matrix()
    return Rotation.from_euler("xyz", numbers, degrees=degrees).as_matrix()


def _numbers(rotations: Array, fmt: Format) -> Array:
    """The numbers (k, 3) of many rotations in a format of degrees."""
    rotation = Rotation.from_matrix(rotations)
    if fmt is Format.ROTVEC_DEG:
        return rotation.as_rotvec(degrees=True)
    return rotation.as_euler("xyz", degrees=True)
