"""What verifications confirm: how far each is off, go or no go, and the tolerance that so many stand for."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.verification import Miss, judge, turned_apart
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.model import Finding, Recording, Touch

LEAST_ANGLES = 2  # of the object: one turn cannot show an axis that stands wrong
_95 = 0.95  # all radii are told at this confidence (u95)
_MOST_WANTED = 50  # nobody verifies more often; a calibration that needs so many is taught anew


@dataclass(frozen=True, slots=True)
class Verified:
    """One verification: how far off it is along what it measured, mm; None where that cannot be told.

    counts: the object had turned since every touch and every other one. fails: chance does not explain it.
    trouble: why it says nothing, else "".
    """

    target: str
    off_mm: float | None
    directions: int
    counts: bool
    fails: bool
    trouble: str = ""

    def to_json(self) -> dict[str, object]:
        """For a result, and to be kept."""
        return asdict(self)

    @classmethod
    def from_json(cls, kept: Mapping[str, Any], *, counts: bool) -> "Verified":
        """As it was kept; whether it counts depends on the others."""
        return cls(
            str(kept["target"]),
            kept["off_mm"],
            int(kept["directions"]),
            counts,
            bool(kept["fails"]),
            str(kept["trouble"]),
        )


@dataclass(frozen=True, slots=True)
class Confirmation:
    """All verifications of a session; confirmed_mm: see `confirmed_mm`, None for too few."""

    verified: tuple[Verified, ...]
    tolerance_mm: float | None

    @property
    def counted(self) -> tuple[Verified, ...]:
        """Those that count."""
        return tuple(one for one in self.verified if one.counts and one.off_mm is not None)

    @property
    def confirmed_mm(self) -> float | None:
        """The tolerance that they confirm."""
        return confirmed_mm([(one.off_mm or 0.0, one.directions) for one in self.counted])

    @property
    def verdict(self) -> str:
        """go, no go, or open: not told yet."""
        if any(one.fails for one in self.verified) or any(map(self._is_too_far, self.counted)):
            return "no go"
        return "go" if len(self.counted) >= LEAST_ANGLES else "open"

    def _is_too_far(self, one: Verified) -> bool:
        return self.tolerance_mm is not None and (one.off_mm or 0.0) > self.tolerance_mm

    @property
    def sentence(self) -> str:
        """For people."""
        counted = len(self.counted)
        if self.verdict == "no go":
            off = ", ".join(f"{one.target} {one.off_mm:.2f} mm" for one in self._bad())
            return (
                f"a verification is off: {off or 'see the findings'}; do not use this calibration"
            )
        if self.verdict == "open":
            return (
                f"{counted} of {LEAST_ANGLES} verifications that count: turn the object by 60 degrees or more from "
                "every touch and from the others, let the tip meet a target, and verify"
            )
        told = f"{counted} verifications, largest miss {max(one.off_mm or 0.0 for one in self.counted):.2f} mm"
        if self.confirmed_mm is None:
            return told
        told += (
            f"; they confirm {self.confirmed_mm:.2f} mm for 95 % of the answers, with 95 % confidence, "
            "their own noise included"
        )
        return told + self._further()

    def _bad(self) -> list[Verified]:
        return [
            one
            for one in self.verified
            if one.off_mm is not None and (one.fails or self._is_too_far(one))
        ]

    def _further(self) -> str:
        """How many more, as good as these, would confirm the tolerance."""
        if self.tolerance_mm is None or (self.confirmed_mm or 0.0) <= self.tolerance_mm:
            return ""
        offs = [(one.off_mm or 0.0, one.directions) for one in self.counted]
        squared = sum(off**2 for off, _ in offs) / len(offs)
        mean = round(sum(n for _, n in offs) / len(offs))
        for count in range(len(offs) + 1, _MOST_WANTED + 1):
            if (confirmed_mm([(squared**0.5, mean)] * count) or np.inf) <= self.tolerance_mm:
                return f"; {count - len(offs)} more as good as these would confirm {self.tolerance_mm:g} mm"
        return f"; no number of them would confirm {self.tolerance_mm:g} mm: teach again"

    def to_json(self) -> dict[str, object]:
        """For a result."""
        return {
            "verdict": self.verdict,
            "words": self.sentence,
            "confirmed_mm": self.confirmed_mm,
            "verifications": [one.to_json() for one in self.verified],
        }


def confirmed_mm(misses: Sequence[tuple[float, int]]) -> float | None:
    """The radius, mm, that holds 95 % of the answers with 95 % confidence, None for fewer than two misses.

    misses: length, mm, and number of directions that it was measured in. Taken as normal, the same in all
    directions and independent from angle to angle: sum(miss^2) / sigma^2 is chi2 of all directions, so its
    5 % quantile bounds sigma from above (Krishnamoorthy and Mathew, Statistical Tolerance Regions, 2009, 1.3).
    The noise of the verifying touches is within it, which makes it larger than the answers' own.
    """
    if len(misses) < LEAST_ANGLES:
        return None
    squared = sum(length**2 for length, _ in misses)
    freedoms = sum(directions for _, directions in misses)
    sigma = np.sqrt(squared / chi2_quantile(1 - _95, freedoms))
    return float(sigma * np.sqrt(chi2_quantile(_95, 3)))


def confirm(
    calibration: Calibration,
    recording: Recording,
    tolerance_mm: float | None,
    stability: Array | None,
) -> Confirmation:
    """What the verifications of a session say of its calibration; stability: as in `verify`."""
    held_out = recording.verifications
    counting = set(turned_apart(recording.touches, held_out))
    judgements = judge(calibration, held_out, stability)
    verified = [
        verified_of(touch, judged, counts=i in counting)
        for i, (touch, judged) in enumerate(zip(held_out, judgements, strict=True))
    ]
    return Confirmation(tuple(verified), tolerance_mm)


def verified_of(touch: Touch, judged: Finding | Miss, *, counts: bool) -> Verified:
    """What `judge` says of a touch."""
    if isinstance(judged, Finding):
        return Verified(touch.target, None, 0, counts, judged.fatal, judged.message)
    return Verified(touch.target, judged.mm, len(judged.off), counts, not judged.share <= 1)
