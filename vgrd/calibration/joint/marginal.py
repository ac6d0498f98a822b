"""From a fit to the solution that is stored and served: the spins are marginalised."""

import numpy as np

from vgrd.calibration.joint.fit import JointFit, whiten_arm
from vgrd.calibration.joint.solution import JointSolution
from vgrd.calibration.joint.state import Columns, StepLayout
from vgrd.geometry import Array
from vgrd.model import ArmKnowledge, frozen_array


def solution_of(fit: JointFit) -> JointSolution:
    """The part of a fit that answers depend on."""
    state, columns = fit.state, kept_columns(fit.layout)
    return JointSolution(
        base_from_camera=state.base_from_camera,
        wrist_from_tag_a=state.wrist_from_tag_a,
        tip_in_wrist=frozen_array(state.tcp_in_wrist, 3),
        base_from_object=state.base_from_object,
        camera_from_tag_b=state.camera_from_tag_b,
        camera_from_axis=state.camera_from_axis,
        axis=fit.layout.axis,
        object_motions=fit.layout.object_motions,
        has_point=fit.layout.has_point,
        covariance=_frozen(fit.covariance[np.ix_(columns, columns)]),
        undetermined=_frozen(fit.undetermined[columns]),
        arm=_arm_knowledge(fit, columns),
    )


def kept_columns(layout: StepLayout) -> Columns:
    """(n,): columns of a fit's unknowns that its solution keeps, in their order."""
    points = layout.point_columns
    return np.concatenate(
        [np.arange(layout.axis_columns.stop), np.arange(points.start, points.stop)]
    )


def _arm_knowledge(fit: JointFit, columns: Columns) -> ArmKnowledge:
    """What the residuals of the arm tell; kept: columns of the unknowns."""
    model = fit.data.arm
    if model.field_mm == 0:
        nothing = np.zeros((0, 0))
        return ArmKnowledge(
            model,
            frozen_array(np.zeros((0, 3)), 0, 3),
            frozen_array(np.zeros(0), 0),
            frozen_array(np.zeros((0, len(columns))), 0, len(columns)),
            frozen_array(nothing, 0, 0),
        )
    G = whiten_arm(fit.arm_factor, fit.J_deviations)
    k = len(G)
    return ArmKnowledge(
        model,
        _frozen(fit.data.flange_at),
        _frozen(G.T @ fit.whitened[:k]),
        _frozen((G.T @ fit.jacobian[:k])[:, columns]),
        _frozen(G.T @ G),
    )


def _frozen(array: Array) -> Array:
    return frozen_array(array, *array.shape)
