"""Sums over pictures: whether a link has slipped and stays so, however little it shows in one picture.

A slip is one more constant, unknown from some picture on (generalised likelihood ratio, Willsky and Jones
1976). What the pictures tell of it has a known covariance while nothing slips, whatever else is learned.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vgrd.calibration.joint.links import SLIP_SCALES, SLIP_SIGMAS, most_likely, size_of
from vgrd.calibration.joint.sequence.belief import Belief, Unexplained
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import SLIPPED
from vgrd.model import Link, SlipEstimate, frozen_array

Named = tuple[tuple[Link, ...], Mapping[Link, tuple[float, float]]]

_ANY = 20.0  # usual slips: wider than any, so that the pictures decide
_TOLD = 1e-6  # of the largest information: what is less is rounding
_NAMED = 0.995  # posterior of the links named: the sum that stops first has luck on its side
_WINDOW = 60  # chosen: pictures, half a minute at 2 Hz, from one start of the sums to the next


class SlipSum:
    """What pictures since `before` tell of a slip of one link that came then."""

    def __init__(self, link: Link, before: Belief) -> None:
        self.link = link
        self.belief = before.copy()
        self.belief.begin_slip(_ANY)

    def add(self, picture: Unexplained) -> None:
        """One picture more."""
        J_slip = picture.J_slips.get(self.link)  # None: the picture does not speak of it
        J_slip = None if J_slip is None else J_slip * SLIP_SIGMAS
        self.belief.learn(self.belief.compare(picture, J_slip))

    @property
    def tells(self) -> bool:
        """Whether the link slipped, beyond chance."""
        along, _ = self.told()
        return len(along) > 0 and float(along @ along) > chi2_quantile(SLIPPED, len(along))

    def told(self) -> tuple[Array, Array]:
        """Numbers (d,), independent of variance 1 while nothing slips, and (d, 6) their means by a slip.

        In usual slips. With information I of the pictures and their score g, the slip is believed to be
        (I + prior)^-1 g; g has covariance I.
        """
        mean, covariance = self.belief.slip
        believed = np.linalg.inv(covariance)
        information, score = believed - np.eye(6) / _ANY**2, believed @ mean
        values, vectors = np.linalg.eigh(0.5 * (information + information.T))
        is_told = values > max(_TOLD * float(values[-1]), 1 / _ANY**2)
        root = np.sqrt(values[is_told])[:, None]
        along = vectors[:, is_told].T
        return along / root @ score, root * along

    def estimate(self) -> SlipEstimate:
        """The slip, in mm and rad.

        A direction that no picture tells is known as well as the slip is large in the others; what
        is believed of the slip is no better known than it is large.
        """
        told, J = self.told()
        along = np.linalg.pinv(J) @ told
        scale = max(float(np.linalg.norm(along)), 1.0 / _ANY)
        covariance = np.linalg.inv(J.T @ J + np.eye(6) / scale**2)
        mean = covariance @ (J.T @ told)
        spread = np.outer(SLIP_SIGMAS, SLIP_SIGMAS) * (covariance + np.outer(mean, mean))
        return SlipEstimate(
            self.link, frozen_array(SLIP_SIGMAS * mean, 6), frozen_array(spread, 6, 6)
        )

    def explain(self) -> tuple[float, Array]:
        """Logarithm of the likelihood that the link slipped over that nothing did, and the slip (6,)."""
        told, J = self.told()
        trials = [_explain(told, J, scale) for scale in SLIP_SCALES]
        evidence = float(np.logaddexp.reduce([evidence for evidence, _ in trials]))
        return evidence, SLIP_SIGMAS * max(trials, key=lambda trial: trial[0])[1]


class SlipSums:
    """A sum for each link that may have slipped since one picture; before: what was known then.

    live_count: of the pictures with tag A and the arm at rest.
    """

    def __init__(self, before: Belief, links: Sequence[Link]) -> None:
        self.before = before.copy()
        self.count = self.live_count = 0
        self.sums = [SlipSum(link, before) for link in links]

    def add(self, picture: Unexplained) -> None:
        """One picture more."""
        self.count += 1
        self.live_count += picture.flange is not None
        for of_link in self.sums:
            of_link.add(picture)

    @property
    def is_old(self) -> bool:
        """Whether the next sums shall begin."""
        return self.count >= _WINDOW

    @property
    def tells(self) -> bool:
        """Whether any link slipped, beyond chance."""
        return any(of_link.tells for of_link in self.sums)

    def named(self) -> Named:
        """Links that may have slipped, most likely first, and how far each would have, (mm, rad).

        What moves with tag B may be the object.
        """
        explained = {of_link.link: of_link.explain() for of_link in self.sums}
        if Link.TAG_B in explained:
            explained[Link.OBJECT] = explained[Link.TAG_B]
        named = most_likely({link: evidence for link, (evidence, _) in explained.items()}, _NAMED)
        return named, MappingProxyType({link: size_of(explained[link][1]) for link in named})


def _explain(told: Array, J: Array, scale: float) -> tuple[float, Array]:
    """As `SlipSum.explain`, for slips of `scale` usual ones."""
    with_slip = np.eye(len(told)) + scale**2 * J @ J.T
    weighted = np.linalg.solve(with_slip, told)
    square = float(told @ told - told @ weighted)
    evidence = 0.5 * (square - float(np.linalg.slogdet(with_slip)[1]))
    return evidence, np.asarray(scale**2 * J.T @ weighted)
