"""What CAD would bring to targets that touches alone tell: the same samples, one place for all of them less free."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from vgrd.calibration.joint import (
    JointData,
    JointFit,
    StepLayout,
    information_inverse,
    linearize,
    whiten_arm,
)
from vgrd.calibration.planning.predicted_error import Job, PredictedError
from vgrd.model import frozen_array


def errors_with_cad_mm(result: JointFit, job: Job) -> dict[str, float]:
    """95 % error (mm) that the job's targets would have were the touched bare ones in CAD as well.

    Every target is taken to be where it is estimated; then no place of its own is left to estimate, and its
    touches tell of the object as those of the others do.
    """
    known = _in_cad(result)
    return PredictedError(known, job).target_errors_mm(_open_too(known), job)


def _open_too(result: JointFit) -> np.ndarray:
    N = result.undetermined
    return np.asarray(result.covariance + N @ N.T)


def _in_cad(result: JointFit) -> JointFit:
    """The fit as its covariance would be with a CAD point for every bare target."""
    data, state = _data_in_cad(result), result.state
    layout: StepLayout = replace(result.layout, bare=())
    known = replace(state, bare_in_base=np.zeros((0, 3)))
    J = whiten_arm(result.arm_factor, linearize(known, data, layout)[1])
    covariance, undetermined = information_inverse(J, layout)
    return replace(
        result,
        data=data,
        layout=layout,
        state=known,
        covariance=covariance * result.variance_scale,
        undetermined=undetermined,
        jacobian=J,
    )


def _data_in_cad(result: JointFit) -> JointData:
    data, state = result.data, result.state
    places = state.base_from_object.inverse() @ state.bare_in_base
    points = {name: frozen_array(p, 3) for name, p in zip(data.bare, places, strict=True)}
    facts = data.recording.facts
    targets = {
        name: replace(target, point_in_object=points.get(name, target.point_in_object))
        for name, target in facts.object.targets.items()
    }
    spec = replace(facts.object, targets=MappingProxyType(targets))
    own = data.bare_of >= 0
    cad = data.cad.copy()
    cad[own] = places[data.bare_of[own]]
    return replace(
        data,
        recording=replace(data.recording, facts=replace(facts, object=spec)),
        cad=cad,
        bare=(),
        bare_of=np.full(len(cad), -1),
    )
