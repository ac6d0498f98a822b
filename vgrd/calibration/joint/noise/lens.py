"""A focal length that is not what the camera file says: tried where the samples are at odds otherwise."""

from collections.abc import Callable

import numpy as np

from vgrd.calibration.joint.camera_corrections import FOCAL
from vgrd.calibration.joint.fit import JointFit
from vgrd.calibration.joint.noise.kinds import FIELD, NOISE_OF_TAG_A, NOISE_OF_TAG_B, STOP
from vgrd.calibration.joint.noise.remarks import level_findings
from vgrd.calibration.joint.problem import EvidenceKind
from vgrd.errors import CalibrationError
from vgrd.judging.findings import finding
from vgrd.model import Finding, Stability

PRIOR_SHARE = 0.01  # sigma of a focal length, of itself: a guess for a lens that was focused anew
_SURE = 4.0  # sigmas of a focal length that is off: 1 in 15,000 good sessions that come so far
_SHOWN_BY = frozenset({STOP, FIELD, NOISE_OF_TAG_A, NOISE_OF_TAG_B})
_PICTURES = frozenset({EvidenceKind.HAND_EYE, EvidenceKind.REFERENCE, EvidenceKind.SPINS})


def with_lens(fit: JointFit, refined: Callable[[], JointFit]) -> tuple[JointFit, Finding | None]:
    """The fit that leaves fewer doubts, and what is told of the lens; refined: solves with the focal length free."""
    doubts = _doubts(fit)
    if not doubts:
        return fit, None
    try:
        other = refined()
    except CalibrationError:
        return fit, None  # the samples do not tell it
    share, sigma = focal_of(other)
    if abs(share) < _SURE * sigma or _doubts(other) >= doubts:
        return fit, None
    words = (
        f"the focal length is {100 * share:+.2f} +- {100 * sigma:.2f} % off what the camera file says; what was "
        "measured counts instead"
    )
    return other, finding("lens_off", words)


def focal_of(fit: JointFit) -> tuple[float, float]:
    """How far the focal length is off, and its sigma, as shares of itself; fit: with it among what is refined."""
    corrections, layout = fit.data.corrections, fit.layout
    index = list(corrections.sigmas).index(FOCAL)
    column = layout.refined_columns.start + index
    focal_px = float(corrections.camera.matrix[0, 0])
    unit = corrections.sigmas[FOCAL] / focal_px
    sigma = unit * float(np.sqrt(fit.covariance[column, column]))
    return unit * float(fit.state.refined[index]), sigma


def _doubts(fit: JointFit) -> int:
    """Pictures left out, moves of a fixed camera, and levels of pictures and arm beyond chance."""
    left_out = sum(not sample.used and sample.kind in _PICTURES for sample in fit.samples)
    is_fixed = fit.recording.facts.camera_stability is Stability.FIXED
    coarse = [level for level in fit.levels if level.name in _SHOWN_BY]
    return left_out + is_fixed * fit.data.places.displaced + len(list(level_findings(coarse)))
