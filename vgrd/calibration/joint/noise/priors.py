"""What a cell file may have wrong, tested: centre, targets in CAD, tag sizes, each against all that was measured.

Each of them is an unknown with a prior. A prior that the samples contradict beyond chance (a deleted residual,
as of a bad sample) is left out and named: what was measured then counts alone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.joint.camera_corrections import STRETCH_A, STRETCH_B, TAG_A, TAG_B
from vgrd.calibration.joint.fit import JointFit, determined_span
from vgrd.calibration.joint.noise.kinds import CENTER
from vgrd.calibration.joint.problem import EvidenceKind, JointData
from vgrd.calibration.joint.state import JointState
from vgrd.calibration.touches import equivalent_sigmas
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.findings import finding
from vgrd.model import Finding

_CONTRADICTED = 1 - 2e-5  # of good sessions, for each of a dozen targets: one session in 4,000
_FEW_CONTRADICTED = 1 - 1e-3  # the same for centre and prints, of which there are few
_HOPELESS = 1 - 1e-8  # six sigmas; three, and one session in a hundred, if noise is twice as large
_TOLD = 1e-3  # share of a prior that the samples check: less is rounding
_FREED = 100.0  # times its sigma: a prior that tells nothing beside any sample
_WORDS = {
    CENTER: ("center_off", "the turntable's centre", "[object] center_mm, or center_sigma_mm"),
    TAG_A: ("tag_size", "the edge of tag A", "[tags.a] size_mm"),
    TAG_B: ("tag_size", "the edge of tag B", "[tags.b] size_mm"),
    STRETCH_A: ("tag_stretched", "width minus height of tag A", "its print"),
    STRETCH_B: ("tag_stretched", "width minus height of tag B", "its print"),
}


@dataclass(frozen=True, slots=True)
class Prior:
    """Numbers of the cell file: by how many sigmas, squared, the samples contradict them.

    off_mm, sigma_mm: from what is stated to what the samples alone say, in the worst direction.
    """

    name: str
    square: float
    freedom: int
    off_mm: float
    sigma_mm: float

    @property
    def sigmas(self) -> float:
        """How many sigmas of one normal value that is."""
        return float(equivalent_sigmas(np.array([self.square]), np.array([self.freedom]))[0])

    @property
    def is_contradicted(self) -> bool:
        """Whether that is beyond chance."""
        return self._is_beyond(_FEW_CONTRADICTED if self.name in _WORDS else _CONTRADICTED)

    @property
    def is_hopeless(self) -> bool:
        """Whether it is so even if all noise were twice as large as taken."""
        return self._is_beyond(_HOPELESS)

    def _is_beyond(self, share: float) -> bool:
        return self.freedom > 0 and self.square > chi2_quantile(share, self.freedom)


def priors_of(fit: JointFit, left_out: Sequence[str] = ()) -> list[Prior]:
    """Every prior of the cell file; left_out: those that do not count in the fit."""
    Q = determined_span(fit.jacobian, fit.layout)
    stated = {level.name: 1 / level.ratio for level in fit.levels if level.name == CENTER}
    return [
        _prior(
            name,
            fit.whitened[rows],
            Q[rows],
            sigma_mm,
            stated.get(name, 1.0) / (_FREED if name in left_out else 1.0),
        )
        for name, rows, sigma_mm in _rows_of(fit.data)
    ]


def contradicted(fit: JointFit, left_out: Sequence[str] = ()) -> Prior | None:
    """The prior that the samples contradict most, beyond chance, of those that count; None: there is none.

    Where levels of noise were not found yet, only one that is hopeless.
    """
    priors = [
        p
        for p in priors_of(fit)
        if p.name not in left_out and (p.is_contradicted if fit.levels else p.is_hopeless)
    ]
    return max(priors, key=lambda prior: prior.sigmas, default=None)


def without(raw: JointData, names: Sequence[str]) -> JointData:
    """The evidence without these priors."""

    def factor(name: str) -> float:
        return _FREED if name in names else 1.0

    turntable, corrections = raw.turntable, raw.corrections
    center_sigma_mm = turntable.center_sigma_mm * factor(CENTER)
    sigmas = {name: sigma * factor(name) for name, sigma in corrections.sigmas.items()}
    own = np.array([factor(_of(target)) for target in raw.inexact])
    return replace(
        raw,
        turntable=replace(turntable, center_sigma_mm=center_sigma_mm),
        corrections=replace(corrections, sigmas=sigmas),
        cad_factors=raw.cad_factors * own,
    )


def at_sigmas(state: JointState, old: JointData, new: JointData) -> JointState:
    """The same state, what is refined counted in the sigmas of other evidence; 0 where only that refines."""
    sigmas = old.corrections.sigmas
    found = {name: sigmas[name] * value for name, value in zip(sigmas, state.refined, strict=True)}
    values = [found.get(name, 0.0) / sigma for name, sigma in new.corrections.sigmas.items()]
    return replace(state, refined=np.array(values, dtype=np.float64))


def in_words(prior: Prior) -> Finding:
    """What is told of a prior that was left out."""
    code, words, key = _WORDS.get(prior.name, ("cad_off", prior.name, "its point_mm"))
    return finding(
        code,
        f"{words} is {prior.off_mm:.2g} +- {prior.sigma_mm:.1g} mm off what the cell file says; what was "
        f"measured counts instead: correct {key}",
    )


def _of(target: str) -> str:
    return f"target {target}"


def _rows_of(data: JointData) -> Iterator[tuple[str, Array, float]]:
    """Name, rows and sigma (mm) of every prior."""
    first = data.rows_of(EvidenceKind.TURNTABLE).start
    if data.center is not None:
        yield CENTER, np.array([first, first + 1]), data.turntable.center_sigma_mm
    first = data.rows_of(EvidenceKind.CAD).start
    for i, target in enumerate(data.inexact):
        rows = first + 3 * i + np.arange(3)
        yield _of(target), rows, data.cad_sigma_mm * float(data.cad_factors[i])
    first = data.rows_of(EvidenceKind.REFINED).start
    for i, (name, sigma_mm) in enumerate(data.corrections.sigmas.items()):
        if name in _WORDS:
            yield name, np.array([first + i]), sigma_mm


def _prior(name: str, whitened: Array, Q: Array, sigma_mm: float, stated: float) -> Prior:
    """The deleted estimate of k numbers, d, and its covariance: R^-1 r and R^-1 - I with R = I - Q Q^T.

    whitened: r (k,), in units of sigma_mm; stated: the sigma that is tested over that.
    """
    values, vectors = np.linalg.eigh(np.eye(len(Q)) - Q @ Q.T)
    told = values > _TOLD
    if not told.any():
        return Prior(name, 0.0, 0, 0.0, np.inf)
    estimate = (vectors.T @ whitened)[told] / values[told]
    own = np.maximum(1 / values[told] - 1, 0.0)
    squares = estimate**2 / (own + stated**2)
    far = int(np.argmax(squares))
    return Prior(
        name,
        float(squares.sum()),
        int(told.sum()),
        sigma_mm * float(abs(estimate[far])),
        sigma_mm * float(np.sqrt(own[far])),
    )
