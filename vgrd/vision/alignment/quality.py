"""What disturbs a tag in a picture, told from what the photometric fit leaves over."""

import numpy as np

from vgrd.vision.alignment.photometric import PhotometricFit
from vgrd.vision.alignment.refinement import Refined, trusted

MOTION_STRETCH = 1.25  # standard deviation of the blur along one direction over that across it
_MOTION_PX2 = 0.25  # and the difference of the variances
_EVEN = 0.03  # of the contrast: paper and print leave as much in even light
_GLARE_SIGMAS = 3.0
_STRIKING = 5.0  # sigma by which a pixel must be off to count


def disturbance(refined: Refined) -> tuple[str, str] | None:
    """Stable code and remark about motion blur, glare, shadow or a covered part; None when clean."""
    fit = refined.fit
    if fit is None:
        return "uneven", "shadow, glare or something else covers it: its edges were measured"
    low, high = np.linalg.eigvalsh(fit.blur).tolist()
    if high - low > _MOTION_PX2 and np.sqrt(high / low) > MOTION_STRETCH:
        stretch = np.sqrt(12 * (high - low))
        return "motion", f"motion blur of {stretch:.1f} px: stand still, or expose more briefly"
    if trusted(fit) or fit.flat_misfit < _EVEN:
        return None
    return _uneven(fit)


def _uneven(fit: PhotometricFit) -> tuple[str, str]:
    """Glare leaves bright places, a shadow dark ones; what covers a part leaves single cells wrong."""
    off = fit.residuals[np.abs(fit.residuals) > _STRIKING]
    index = np.ravel_multi_index(fit.cells.T[::-1], fit.cells.max(0)[::-1] + 1)
    squares = np.bincount(index, fit.residuals**2) / np.maximum(np.bincount(index), 1)
    bad = np.mean(squares[np.bincount(index) > 0] > _STRIKING)
    if bad < 0.2:
        return "covered", "a part of it is covered or dirty: clean it; its edges were measured"
    if off.size and off.mean() > _GLARE_SIGMAS:
        return "glare", "glare on it: move the lamp or the tag; its edges were measured"
    return "shadow", "shadow or glare across it: make the light even; its edges were measured"
