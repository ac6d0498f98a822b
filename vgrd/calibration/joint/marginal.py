"""From a fit to the solution that is stored and served: spins and the camera's displacements are marginalised."""

import numpy as np

from vgrd.calibration.joint.fit import JointFit, units, whiten_arm
from vgrd.calibration.joint.solution import JointSolution, Refinement
from vgrd.calibration.joint.state import Columns, StepLayout
from vgrd.geometry import Array
from vgrd.model import ArmKnowledge, frozen_array, frozen_copy

_OPEN = 1e-3  # of 500 mm or 1 rad: less is open in what is left out, not in what is kept


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
        bare=fit.layout.bare,
        bare_in_base=frozen_copy(state.bare_in_base),
        inexact=fit.layout.inexact,
        offsets_in_object=frozen_copy(state.offsets_in_object),
        refined={
            name: Refinement(sigma, float(value))
            for (name, sigma), value in zip(
                fit.data.corrections.sigmas.items(), state.refined, strict=True
            )
        },
        levels=fit.levels,
        covariance=frozen_copy(fit.covariance[np.ix_(columns, columns)]),
        undetermined=frozen_copy(_undetermined(fit, columns)),
        arm=_arm_knowledge(fit, columns),
    )


def kept_columns(layout: StepLayout) -> Columns:
    """(n,): columns of a fit's unknowns that its solution keeps, in their order."""
    points, refined = layout.point_columns, layout.refined_columns
    return np.concatenate(
        [np.arange(layout.axis_columns.stop), np.arange(points.start, refined.stop)]
    )


def _undetermined(fit: JointFit, columns: Columns) -> Array:
    """Directions (n, z) that matter to what is kept; others are open in a displacement alone."""
    kept = fit.open_directions[columns]
    if not fit.layout.places:
        return kept
    scales = units(fit.layout)[columns, None]
    U, s, _ = np.linalg.svd(kept / scales, full_matrices=False)
    return np.asarray(scales * (U * s)[:, s > _OPEN])


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
    G = whiten_arm(fit.arm_factor, fit.deviation_jacobian)
    k = len(G)
    if fit.layout.places:
        G, k = _beside_displacements(G, fit, columns), len(fit.whitened)
    return ArmKnowledge(
        model,
        frozen_copy(fit.data.flange_at),
        frozen_copy(G.T @ fit.whitened[:k]),
        frozen_copy((G.T @ fit.jacobian[:k])[:, columns]),
        frozen_copy(G.T @ G),
    )


def _beside_displacements(G: Array, fit: JointFit, columns: Columns) -> Array:
    """Rows (r, 6 s) of the deviations as far as no unknown that is left out takes them up.

    The camera's displacements share rows with the arm: what is told of it must not take them for known.
    """
    others = np.setdiff1d(np.arange(fit.layout.size), columns)
    N = fit.jacobian[:, others] * units(fit.layout)[others]
    U, s, _ = np.linalg.svd(N, full_matrices=False)
    U = U[:, s > 1.0]
    rows = np.zeros((len(N), G.shape[1]))
    rows[: len(G)] = G
    return np.asarray(rows - U @ (U.T @ rows))
