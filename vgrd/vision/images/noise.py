"""How noisy a picture is, told by its flat pixels."""

from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.vision.images.compiling import compiled

_LEAST_VARIANCE = 1 / 12  # rounding to whole grey levels
_FEW_PIXELS = 30
_DIRTY = 25.0  # squared sigmas


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Variance of a grey level I: shot * I + read."""

    shot: float
    read: float


def noise_in(flat: Array) -> Noise:
    """Noise from flat pixels (n, 3): colour, level, second difference."""
    found = [(level, variance) for level, variance, n in _noise_of(flat) if n >= _FEW_PIXELS]
    if not found:
        return Noise(0.0, 1.0)
    (dark, variance), (bright, most) = found[0], found[-1]
    shot = max((most - variance) / max(bright - dark, 1.0), 0.0) if len(found) > 1 else 0.0
    return Noise(shot, max(variance - shot * dark, _LEAST_VARIANCE))


@compiled
def _noise_of(flat: Array) -> Array:
    """Mean level, variance of the noise, and number of the clean ones, of black and white flat pixels (2, 3).

    The variance of a second difference is 1 + 4 + 1 times that of a pixel; what is five sigma off is dirt.
    """
    found = np.zeros((2, 3))
    for colour in range(2):
        most = np.inf
        for _ in range(3):
            level, squares, n = 0.0, 0.0, 0
            for i in range(len(flat)):
                square = flat[i, 2] * flat[i, 2]
                if flat[i, 0] == colour and square <= most:
                    level, squares, n = level + flat[i, 1], squares + square, n + 1
            if n == 0:
                break
            most = _DIRTY * max(squares / n, 1.0)
            found[colour, 0], found[colour, 1], found[colour, 2] = level / n, squares / (6 * n), n
    return found
