"""What is told of levels of noise that are not as stated."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vgrd.calibration.joint.noise.kinds import (
    ACROSS,
    ALONG,
    CAD,
    CENTER,
    FIELD,
    HOLES,
    NOISE_OF_TAG_A,
    NOISE_OF_TAG_B,
    POINT,
    STOP,
)
from vgrd.calibration.levels import Level
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import WRONG_SIGMA
from vgrd.model import Finding

_BY_CHANCE = (
    1e-4  # of good sessions, for either side of each of a dozen levels: 1 in 1,000 over all
)
_MATTERS = 1.33  # a third of a sigma: less changes no decision
_CODES: Mapping[str, str] = MappingProxyType(
    {
        ACROSS: "touch_noise",
        ALONG: "touch_noise",
        POINT: "point_noise",
        NOISE_OF_TAG_A: "tag_noise",
        NOISE_OF_TAG_B: "tag_noise",
        HOLES: "hole_noise",
        STOP: "arm_noise",
        FIELD: "arm_noise",
        CAD: "cad_noise",
        CENTER: "center_off",
    }
)
_TOLD_IF_FINER = (
    ACROSS,
    ALONG,
    POINT,
)  # what people do; that a sensor is better than stated is no news


def level_findings(levels: Sequence[Level]) -> Iterator[Finding]:
    """Levels that are far from what the cell file says, or from what pictures promise."""
    for level in levels:
        is_finer = level.found < level.stated
        if is_finer and level.name not in _TOLD_IF_FINER:
            continue
        if abs(np.log(level.ratio)) > np.log(_MATTERS) and _is_beyond_chance(level):
            yield finding(_CODES[level.name], _words(level), fatal=level.ratio > WRONG_SIGMA)


def _is_beyond_chance(level: Level) -> bool:
    """By the chi-square that its freedom stands for: few samples come out far too fine more often than too coarse."""
    square = level.freedom * level.ratio**2
    least, most = (chi2_quantile(p, level.freedom) for p in (_BY_CHANCE, 1 - _BY_CHANCE))
    return not least < square < most


def _words(level: Level) -> str:
    if level.unit == "x":
        return f"{level.name} scatter {level.ratio:.1f} times as much as they promise"
    return (
        f"{level.name}: {level.found:.2g} {level.unit} (1 sigma), the cell file says "
        f"{level.stated:.2g}"
    )
