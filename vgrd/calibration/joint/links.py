"""Which link moved: a picture that the calibration does not explain, explained by one link that slipped.

Each link is given a slip, small, middling or large, and the likelihood of the picture says how probable
each one is. The camera may have been knocked besides, which tag A follows. Links that a picture cannot tell apart
explain it alike and are named together.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from vgrd.calibration.joint.picture import PictureModel
from vgrd.geometry import Array
from vgrd.model import Link

SLIP_SIGMAS = np.array([1.0] * 3 + [4e-3] * 3)  # mm, rad: a guess, 1 mm over a tag turns it more
SLIP_SCALES = (
    0.2,
    1.0,
    5.0,
)  # of slips, equally likely: from what glue lets go to what an elbow does
_KNOCK = 30.0  # times its stability: how far a camera may have been knocked besides
_KNOCKED = 0.01  # a guess: how many cameras have been, when something else slips
_NAMED = 0.95  # posterior that the links which are named hold together


def suspects(
    model: PictureModel,
) -> tuple[tuple[Link, ...], Mapping[Link, tuple[float, float]]]:
    """Links that may have moved, most likely first, and how far each would have, (mm, rad).

    Slips of tags are in the tag's frame, of the camera in its own. The model has the camera's stability
    as it is configured, whether or not tag A contradicts it.
    """
    rows, guess, across = model.rows, model.guess, _across(model)
    r, S = across.T @ rows.residual, across.T @ model.covariance @ across
    spreads = [(0.0, S)]
    if not (guess.place.is_exact or guess.place.is_free):
        spreads.append((np.log(_KNOCKED), S + _KNOCK**2 * across[-6:].T @ across[-6:]))
    evidence, slips = {}, {}
    for link, J in slip_jacobians(model).items():
        trials = [
            _explain(r, spread, across.T @ J, scale, prior)
            for prior, spread in spreads
            for scale in SLIP_SCALES
        ]
        evidence[link] = float(np.logaddexp.reduce([evidence for evidence, _ in trials]))
        slip = max(trials, key=lambda trial: trial[0])[1]
        slips[link] = size_of(slip)
    named = most_likely(evidence)
    return named, MappingProxyType({link: slips[link] for link in named})


def slip_traces(model: PictureModel) -> Mapping[Link, Array]:
    """How a slip (mm, rad) of each link shows: (f, 6), in sigmas, of the f numbers that tell something.

    They are what is left of a picture once motion and camera are fitted, whitened by noise and
    estimate. Slips are as in `suspects`. A link that the picture does not speak of shows nowhere.
    """
    across = _across(model)
    L = np.linalg.cholesky(across.T @ model.covariance @ across)
    shown = {link: np.linalg.solve(L, across.T @ J) for link, J in slip_jacobians(model).items()}
    return MappingProxyType({link: shown.get(link, np.zeros((len(L), 6))) for link in Link})


def _across(model: PictureModel) -> Array:
    """Orthonormal (r, f): what neither motion nor camera explains."""
    free = model.free
    return np.asarray(np.linalg.svd(free, full_matrices=True)[0][:, free.shape[1] :])


def size_of(slip: Array) -> tuple[float, float]:
    """How far a slip (6,) is, (mm, rad)."""
    return float(np.linalg.norm(slip[:3])), float(np.linalg.norm(slip[3:]))


def _explain(r: Array, S: Array, J: Array, scale: float, prior: float) -> tuple[float, Array]:
    """Logarithm of the likelihood under slips of that size and of the prior, and the likely slip (6,)."""
    L = J * (scale * SLIP_SIGMAS)
    with_slip = S + L @ L.T
    weighted = np.linalg.solve(with_slip, r)
    evidence = prior - 0.5 * (float(r @ weighted) + float(np.linalg.slogdet(with_slip)[1]))
    return evidence, scale * SLIP_SIGMAS * (L.T @ weighted)


def slip_jacobians(model: PictureModel) -> dict[Link, Array]:
    """Derivative (r, 6) of the residuals by the slip of each link that the picture speaks of."""
    rows, guess = model.rows, model.guess
    of_b = np.zeros((len(rows.residual), 6))
    of_b[:6] = rows.J_tag_b
    out = {Link.TAG_B: of_b, Link.OBJECT: of_b}
    if guess.tag_a is not None:
        out[Link.TAG_A] = np.zeros_like(of_b)
        out[Link.TAG_A][6:12] = rows.J_tag_a
    if guess.place.is_exact:
        out[Link.CAMERA] = rows.J_camera
    elif not guess.place.is_free:
        out[Link.CAMERA] = np.zeros_like(of_b)
        out[Link.CAMERA][-6:] = np.diag(1 / guess.place.stability)
    return out


def most_likely(evidence: Mapping[Link, float], share: float = _NAMED) -> tuple[Link, ...]:
    """The fewest links that hold that share of the posterior; ties stay together."""
    order = sorted(evidence, key=lambda link: -evidence[link])
    weights = np.exp(np.array([evidence[link] for link in order]) - evidence[order[0]])
    shares = np.cumsum(weights) / weights.sum()
    count = int(np.searchsorted(shares, share)) + 1
    least = weights[count - 1]
    return tuple(link for link, w in zip(order, weights, strict=True) if w >= least * (1 - 1e-9))
