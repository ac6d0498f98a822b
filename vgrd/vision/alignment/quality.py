"""What disturbs a tag in a picture, told from what the photometric fit leaves over."""

import numpy as np

from vgrd.vision.alignment.photometric_fit import PhotometricFit
from vgrd.vision.alignment.refinement import WORST_CHI2, Refined, trusted

MOTION_STRETCH = 1.25  # of the blur, along over across: a motion of 2 px at the usual 0.75 px
_MOTION_PX2 = 0.25  # difference of the variances along and across: a motion of 1.7 px, L^2 / 12
_EVEN = 0.03  # of the contrast: paper and print leave as much in even light
_HAZE = 0.016  # of the contrast, in flat pixels; drawn: wings of a poor lens 0.017 to 0.026, clean 0.004
_GLARE_SIGMAS = 3.0  # mean of the striking residuals: glare only adds light
_STRIKING_SIGMAS = 5.0  # no noise does that among 10,000 pixels
_BAD_CELL = 5.0  # mean square of a cell's residuals, 1 where the model holds; a guess: clear of it
_COVERED = 0.2  # share of bad cells; light across a tag spoils more


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


def disturbance_of_tag(refined: Refined) -> tuple[str, str] | None:
    """As `disturbance`, and what makes a single tag less sure than its covariance says; None when clean.

    That is light which a lens scatters from white into black, and edges that are not as drawn: of a board
    another remark tells why, and many edges are sure all the same.
    """
    trouble, fit = disturbance(refined), refined.fit
    if trouble is not None or fit is None:
        return trouble
    beyond = max(fit.flat_misfit, fit.veiled)
    if beyond >= _HAZE and (fit.chi2 >= WORST_CHI2 or fit.veiled):
        remedy = "clean lens and window, or save without loss"
        return "haze", f"light spreads from white into black ({100 * beyond:.0f} %): {remedy}"
    if not trusted(fit):
        share = 100 * fit.misfit
        return "uneven", f"it is not as drawn ({share:.0f} %): its edges alone were measured"
    return None


def _uneven(fit: PhotometricFit) -> tuple[str, str]:
    """Tell a cover, which spoils few cells, from glare (bright residuals) and from a shadow."""
    striking = fit.residuals[np.abs(fit.residuals) > _STRIKING_SIGMAS]
    bad = np.mean(fit.cell_squares > _BAD_CELL)
    if bad < _COVERED:
        return "covered", "a part of it is covered or dirty: clean it; its edges were measured"
    if striking.size and striking.mean() > _GLARE_SIGMAS:
        return "glare", "glare on it: move the lamp or the tag; its edges were measured"
    return "shadow", "shadow or glare across it: make the light even; its edges were measured"
