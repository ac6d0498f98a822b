"""The joint estimate at the levels of noise that its samples show, without what these contradict."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vgrd.calibration.joint.fit import JointFit, fit_joint
from vgrd.calibration.joint.knocks import Trial
from vgrd.calibration.joint.noise.levels import Noise, at_levels
from vgrd.calibration.joint.noise.priors import Prior, contradicted, freed, in_words, refined_at
from vgrd.calibration.joint.problem import JointData
from vgrd.calibration.joint.robust import screen
from vgrd.calibration.joint.state import layout_of
from vgrd.geometry import Array

_ROUNDS = 4  # a bound only: levels and estimate settle in two
_SETTLED = 0.03  # of a logarithm: 3 % of a sigma
_JUDGED_ANEW = 0.2  # of a logarithm: 20 % of a sigma, which may make a sample good or bad
_MOST_FREED = 4  # a file with more that is wrong is that of another cell

Scales = Mapping[str, float]


def at_found_levels(data: JointData, trial: Trial, *, robust: bool) -> JointFit:
    """The fit at the most likely levels; data: all samples as gathered, at the stated ones, as the trial.

    robust: samples that the others contradict are judged anew by the new levels, and so is what the cell
    file says.
    """
    fit, scales = _settle(trial.screened.raw, trial.screened, {})
    if not robust:
        return fit
    if max((abs(np.log(scale)) for scale in scales.values()), default=0.0) > _JUDGED_ANEW:
        every = at_levels(data, scales)
        screened = screen(every, fit_joint(every, layout_of(every), trial.optimum.state))
        fit, scales = _settle(at_levels(screened.raw, _inverse(scales)), screened, scales)
    found: list[Prior] = []
    while len(found) < _MOST_FREED and (worst := contradicted(fit)) is not None:
        found.append(worst)
        raw = freed(at_levels(fit.raw, _inverse(scales)), worst.name)
        state = replace(fit.state, refined=refined_at(fit, raw))
        samples = fit.samples
        fit = replace(fit_joint(at_levels(raw, scales), fit.layout, state), samples=samples)
        fit, scales = _settle(raw, fit, scales)
    return replace(fit, freed=tuple(in_words(prior) for prior in found))


def _settle(raw: JointData, fit: JointFit, scales: Scales) -> tuple[JointFit, Scales]:
    """Levels and estimate in turns; raw: the samples in use, at the stated levels; fit: at `scales`."""
    start: Array | None = None
    samples = fit.samples
    for _ in range(_ROUNDS):
        noise = Noise(raw, fit.layout, fit.state)
        levels = noise.find(start)
        start = levels.log_variances
        found = dict(zip(noise.parts, map(float, levels.scales), strict=True))
        changes = [abs(np.log(scale / scales.get(name, 1.0))) for name, scale in found.items()]
        scales = found
        if max(changes, default=0.0) < _SETTLED and fit.levels:
            break
        fit = fit_joint(at_levels(raw, scales), fit.layout, fit.state)
        fit = replace(fit, samples=samples, levels=noise.named(levels))
    return fit.widened(noise.widening(levels)), scales


def _inverse(scales: Scales) -> Scales:
    return {name: 1 / scale for name, scale in scales.items()}
