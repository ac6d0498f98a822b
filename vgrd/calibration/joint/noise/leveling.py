"""The joint estimate at the levels of noise that its samples show, without what these contradict."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vgrd.calibration.joint.fit import JointFit, fit_joint
from vgrd.calibration.joint.knocks import Trial
from vgrd.calibration.joint.noise.levels import Noise, at_levels
from vgrd.calibration.joint.noise.priors import (
    at_sigmas,
    contradicted,
    in_words,
    priors_of,
    without,
)
from vgrd.calibration.joint.problem import JointData
from vgrd.calibration.joint.robust import screen
from vgrd.calibration.joint.state import layout_of
from vgrd.geometry import Array

_ROUNDS = 4  # a bound only: levels and estimate settle in two
_SETTLED = 0.05  # of a logarithm: 5 % of a sigma, of which a tenth is known at best
_JUDGED_ANEW = 1.2  # times a sigma, which may make a bad sample good
_MOST_LEFT_OUT = 4  # a file with more that is wrong is that of another cell

Scales = Mapping[str, float]


def at_found_levels(data: JointData, trial: Trial, *, robust: bool) -> JointFit:
    """The fit at the most likely levels; data: all samples as gathered, at the stated ones, as the trial.

    robust: samples that the others contradict are judged anew by the new levels, and so is what the cell
    file says.
    """
    if not robust:
        return _settle(trial.screened.raw, trial.screened, {})[0]
    search = _Search(data, trial)
    search.doubt()
    search.level()
    search.restore()
    search.doubt()
    return search.result()


class _Search:
    """Which priors of the cell file count, and the levels of noise beside them.

    A wrong prior and a rough operator look alike. What the samples contradict at the stated levels is left out
    first, so that no level takes it up; what the levels found without it explain comes back.
    """

    def __init__(self, data: JointData, trial: Trial) -> None:
        self._every = data
        self._state = trial.optimum.state
        self._left_out: tuple[str, ...] = ()
        self._scales: Scales = {}
        self._fit = trial.screened

    def doubt(self) -> None:
        """Leave out, one after the other, what the samples contradict."""
        while len(self._left_out) < _MOST_LEFT_OUT:
            worst = contradicted(self._fit, self._left_out)
            if worst is None:
                return
            self._left_out = (*self._left_out, worst.name)
            self._fit_anew()
            if self._scales:
                self._settle()

    def level(self) -> None:
        """Find the levels; samples that were left out are judged anew by coarser ones."""
        self._settle()
        coarser = max(self._scales.values(), default=1.0)
        if coarser > _JUDGED_ANEW and not all(sample.used for sample in self._fit.samples):
            self._fit_anew()
            self._settle()

    def restore(self) -> None:
        """Take back the priors that the samples do not contradict at the levels found without them."""
        guilty = {p.name for p in priors_of(self._fit, self._left_out) if p.is_contradicted}
        if not guilty.issuperset(self._left_out):
            self._left_out = tuple(name for name in self._left_out if name in guilty)
            self._fit_anew()
            self._settle()

    def result(self) -> JointFit:
        """The fit, with what is told of the priors that do not count."""
        told = {prior.name: prior for prior in priors_of(self._fit, self._left_out)}
        return replace(self._fit, freed=tuple(in_words(told[name]) for name in self._left_out))

    def _fit_anew(self) -> None:
        """All samples without the priors left out; the bad ones left out too.

        They are judged by no finer level than stated: what errs alike in all of them is no outlier.
        """
        self._scales = {name: max(scale, 1.0) for name, scale in self._scales.items()}
        every = at_levels(without(self._every, self._left_out), self._scales)
        state = at_sigmas(self._state, self._every, every)
        self._fit = screen(every, fit_joint(every, layout_of(every), state))

    def _settle(self) -> None:
        raw = at_levels(self._fit.raw, _inverse(self._scales))
        self._fit, self._scales = _settle(raw, self._fit, self._scales)


def _settle(raw: JointData, fit: JointFit, scales: Scales) -> tuple[JointFit, Scales]:
    """Levels and estimate in turns; raw: the samples in use, at the stated levels; fit: at `scales`."""
    start: Array | None = None
    samples = fit.samples
    for _ in range(_ROUNDS):
        noise = Noise(raw, fit.layout, fit.state)
        if start is None and scales:
            start = 2 * np.log([scales.get(name, 1.0) for name in noise.parts])
        levels = noise.find(start)
        start = levels.log_variances
        found = dict(zip(noise.parts, map(float, levels.scales), strict=True))
        changes = [abs(np.log(scale / scales.get(name, 1.0))) for name, scale in found.items()]
        if scales and max(changes, default=0.0) < _SETTLED:
            fit = replace(fit, levels=noise.named(levels))
            break
        scales = found
        fit = fit_joint(at_levels(raw, scales), fit.layout, fit.state, is_near=True)
        fit = replace(fit, samples=samples, levels=noise.named(levels))
    return fit.widened(noise.widening(levels)), scales


def _inverse(scales: Scales) -> Scales:
    return {name: 1 / scale for name, scale in scales.items()}
