"""Is a calibration from a recording good? What the samples left out say, at 95 %, and what limits it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vgrd.calibration.hand_eye import HandEyeResult
from vgrd.calibration.levels import wider_by_freedom
from vgrd.geometry import Array
from vgrd.geometry.covariance import radius95_of_mixture

_ORDER_FROM = 19  # samples of which the largest miss of n is beyond 95 % of the next: n / (n + 1)
_WHOLE = 99.5  # from here on two figures would need a power of ten
_SIZE = "size of the target"
_ADVICE: Mapping[str, str] = {
    _SIZE: "its true size in the file, measured with a caliper",
    "pixels": "a sharper picture, a larger target or a nearer one",
    "pixels alike in a picture": "a camera calibration of its own, a flat target, all of it in the picture",
    "arm's position": "poses read at rest, a stiffer grip of the target, a calibrated arm",
    "arm's turn": "poses read at rest and with all their digits, a stiffer grip, a calibrated arm",
    "positions": "better poses of the target (sharper, larger, nearer), robot poses read at rest",
    "target's turn": "better poses of the target: a larger or nearer one",
    "number and spread of the poses": "more samples, with tilts of 20 degrees and more about different axes",
}


@dataclass(frozen=True, slots=True)
class Quality:
    """mm, deg: what 95 of 100 further looks are predicted to within, NaN where unknown.

    Out of sample; it holds the error of the calibration, of one robot pose and of one look. distance_mm:
    between camera and target, median. calibration_mm: the calibration's part at a true flange pose, 95 % of
    looks like the samples. size_mm: what a
    target of another size than given adds at that distance, in mm too; 0 where it has that size. limits: the
    largest cause; advice: what lowers it.
    """

    mm: float
    deg: float
    count: int
    distance_mm: float
    calibration_mm: float
    size_mm: float
    limits: str
    advice: str

    @property
    def sentence(self) -> str:
        """The answer in words."""
        if not np.isfinite(self.mm):
            return f"unknown how good it is: {self.count} samples are too few to leave one out; add samples"
        return (
            f"at 95 % a point {figure(self.distance_mm)} mm before the camera is predicted to within "
            f"{figure(self.mm)} mm and {figure(self.deg)} deg, from {self.count} samples, each predicted without "
            f"itself; noise of one look and one robot pose included, the calibration alone "
            f"{figure(self.calibration_mm)} mm"
        )


def figure(value: float) -> str:
    """Two figures, whole numbers in full: 0.33, 14, 328."""
    return f"{value:.2g}" if abs(value) < _WHOLE else f"{value:.0f}"


def quality_of(
    result: HandEyeResult,
    shifts_mm: Sequence[Array],
    turns_rad: Sequence[Array],
    expected: Sequence[Array],
    distance_mm: float,
    excess: float = 0.0,
) -> Quality:
    """shifts_mm, turns_rad: (3,) by which the fit without each sample missed it; empty where unknown.

    expected: (6, 6) of the place and turn that this fit expected there, by its covariance, mm and rad.
    excess: by which the target is larger than given, as a share.
    """
    misses = [C + look for C, look in zip(expected, result.looks, strict=bool(expected))]
    strays = not all(sample.used for sample in result.samples)
    largest = max(result.shares, key=lambda name: result.shares[name], default="")
    spread_mm = within_95(shifts_mm, [C[:3, :3] for C in misses], strays=strays)
    size_mm = abs(excess) * distance_mm
    if size_mm > spread_mm:
        largest = _SIZE
    return Quality(
        spread_mm + size_mm,  # an offset that is the same in every look adds as it is
        float(np.degrees(within_95(turns_rad, [C[3:, 3:] for C in misses], strays=strays))),
        len(result.samples),
        distance_mm,
        radius95_of_mixture([C[:3, :3] for C in expected]) if expected else np.nan,
        size_mm,
        largest,
        _ADVICE.get(largest, ""),
    )


def within_95(
    misses: Sequence[Array], covariances: Sequence[Array], *, strays: bool = False
) -> float:
    """Radius that holds a further miss (3,) at 95 %; where many are known, at least their own quantile.

    covariances: (3, 3) of each miss, as the fit has it. They say how misses differ from sample to sample, which
    makes the tails; how large they are is told by the misses themselves, with so many degrees of freedom.
    strays: some belong to no common pose; of those that come no law is known, but that n of n + 1 are no larger
    than the largest here.
    """
    if not len(misses):
        return float("nan")
    lengths = np.linalg.norm(misses, axis=1)
    totals = np.array([np.trace(C) for C in covariances])
    if totals.sum() == 0:
        return float(lengths.max())
    scale = float(np.sqrt(np.sum(lengths**2) / totals.sum()))
    freedom = float(totals.sum()) ** 2 / float(sum(np.sum(C * C) for C in covariances))
    radius = scale * radius95_of_mixture(covariances) * wider_by_freedom(freedom)
    if len(misses) < _ORDER_FROM:
        return max(radius, float(lengths.max())) if strays else radius
    return max(radius, float(np.sort(lengths)[int(np.ceil(0.95 * (len(misses) + 1))) - 1]))
