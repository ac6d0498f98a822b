"""From a fit to the solution that is stored and served: the spins are marginalised."""

import numpy as np

from vgrd.calibration.joint.fit import JointFit, whiten_arm
from vgrd.calibration.joint.solution import JointSolution
from vgrd.calibration.joint.state import Columns, StepLayout
from vgrd.model import ArmKnowledge, frozen_array, frozen_copy


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
        covariance=frozen_copy(fit.covariance[np.ix_(columns, columns)]),
        undetermined=frozen_copy(fit.undetermined[columns]),
        arm=_arm_knowledge(fit, columns),
    )


def kept_columns(layout: StepLayout) -> Columns:
    """(n,): columns of a fit's unknowns that its solution keeps, in their order."""
    points = layout.point_columns
    return np.concatenate(
        [np.arange(layout.axis_columns.stop), np.arange(points.start, points.stop)]
    )


def _arm_knowledge(fit: JointFit, columns: Columns) -> ArmKnowledge:
    """What the residuals of the arm tell; columns: of the unknowns that are kept."""
    model = fit.data.arm
    if model.field_mm == 0:
        return ArmKnowledge(
            model,
            frozen_copy(np.zeros((0, 3))),
            frozen_copy(np.zeros(0)),
            frozen_copy(np.zeros((0, len(columns)))),
            frozen_copy(np.zeros((0, 0))),
        )
    G = whiten_arm(fit.arm_factor, fit.J_deviations)
    k = len(G)
    return ArmKnowledge(
        model,
        frozen_copy(fit.data.flange_at),
        frozen_copy(G.T @ fit.whitened[:k]),
        frozen_copy((G.T @ fit.jacobian[:k])[:, columns]),
        frozen_copy(G.T @ G),
    )
