"""How noisy a picture is, told by its flat pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.geometry import Array
from vgrd.vision.images.compiling import compiled

_LEAST_VARIANCE = 1 / 12  # rounding to whole grey levels
_LEAST_PIXELS = 30  # of one colour: their variance is known to 26 %, sqrt(2 / 30)
_WORST_VARIANCE = (
    25.0  # of what a fit leaves: white's noise at 34 dB, a camera with a gain of 12 dB
)
_DIRTY = 25.0  # squared sigmas: no noise does that among 10,000 pixels
_ROUNDS = 3  # of leaving out dirt: the second has its sigma without the worst of it
_OF_SECOND_DIFFERENCE = 6  # 1 + 4 + 1: its variance over that of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class CameraNoise:
    """Variance of a grey level I: shot * I + read."""

    shot: float
    read: float


UNKNOWN_NOISE = CameraNoise(0.0, 1.0)  # a good camera in the dark


def noise_in(flat: Array, worst: float = np.inf) -> CameraNoise | None:
    """Noise from flat pixels (n, 3): colour, level, second difference (16 in docs/photometric.md).

    worst: the largest variance to believe. None where neither colour has enough pixels.
    """
    levels = [
        (level, min(variance, worst))
        for level, variance, n in _noise_of(flat)
        if n >= _LEAST_PIXELS
    ]
    if not levels:
        return None
    (dark, variance), (bright, most) = levels[0], levels[-1]
    shot = max((most - variance) / max(bright - dark, 1.0), 0.0) if len(levels) > 1 else 0.0
    return CameraNoise(shot, max(variance - shot * dark, _LEAST_VARIANCE))


def noise_left(
    pixels: NDArray[np.intp], model: Array, rest: Array, middle: float
) -> CameraNoise | None:
    """Noise from what a fit leaves of pixels (n, 2), column and row, where none of them is flat.

    model (n,): their levels as fitted; rest (n,): what is above them; middle: level between black and white.
    Second differences of the rest do not feel what varies slowly: light, a bend, a veil.
    """
    low = pixels.min(0)
    column, row = (pixels - low).T
    spread = np.full((row.max() + 1, column.max() + 1), np.nan)
    spread[row, column] = rest
    bend = np.full_like(spread, np.nan)
    bend[:, 1:-1] = spread[:, :-2] - 2 * spread[:, 1:-1] + spread[:, 2:]
    bends = np.column_stack([model > middle, model, bend[row, column]])
    return noise_in(bends[np.isfinite(bends[:, 2])], _WORST_VARIANCE)


@compiled
def _noise_of(flat: Array) -> Array:
    """Mean level, variance of the noise, and number of the clean pixels, of black and of white: (2, 3).

    A second difference of more than five sigma is dirt.
    """
    noise = np.zeros((2, 3))
    for colour in range(2):
        most = np.inf
        for _ in range(_ROUNDS):
            level, squares, n = 0.0, 0.0, 0
            for i in range(len(flat)):
                square = flat[i, 2] * flat[i, 2]
                if flat[i, 0] == colour and square <= most:
                    level, squares, n = level + flat[i, 1], squares + square, n + 1
            if n == 0:
                break
            most = _DIRTY * max(squares / n, 1.0)
            variance = squares / (_OF_SECOND_DIFFERENCE * n)
            noise[colour, 0], noise[colour, 1], noise[colour, 2] = level / n, variance, n
    return noise
