"""What expected coordinates rest on: the joint estimate, fresh from a session or as it was stored."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.estimate import JointResult
from vgrd.calibration.joint.fit import whiten_arm
from vgrd.calibration.joint.state import JointState, Layout
from vgrd.geometry import Array
from vgrd.model import CellFacts, frozen_array
from vgrd.model.estimate import ArmKnowledge, JointEstimate


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """Values of the unknowns, their covariance (n, n), what is left open (n, z), and the arm."""

    facts: CellFacts
    state: JointState
    layout: Layout
    covariance: Array
    undetermined: Array
    arm: ArmKnowledge


def basis_of(result: JointResult) -> Basis:
    """All unknowns of a session, those of its spins included."""
    return Basis(
        result.recording.facts,
        result.state,
        result.layout,
        result.covariance,
        result.undetermined,
        _arm_knowledge(result),
    )


def stored_basis(estimate: JointEstimate, facts: CellFacts) -> Basis:
    """As it was when the session was solved."""
    state = JointState(
        base_from_camera=estimate.base_from_camera,
        wrist_from_tag_a=estimate.wrist_from_tag_a,
        tcp_in_wrist=estimate.tcp_in_wrist,
        base_from_object=estimate.base_from_object,
        camera_from_tag_b=estimate.camera_from_tag_b,
        camera_from_axis=estimate.camera_from_axis,
        table_motion=np.zeros((0, 3)),
        fixed_point_in_base=np.zeros(3),
    )
    layout = Layout(estimate.axis, estimate.moves, spins=0, has_point=False)
    return Basis(facts, state, layout, estimate.covariance, estimate.undetermined, estimate.arm)


def to_store(basis: Basis) -> JointEstimate:
    """The part that answers depend on: spins and the fixed point are marginalised."""
    state, n = basis.state, basis.layout.axis_columns.stop
    arm = basis.arm
    return JointEstimate(
        base_from_camera=state.base_from_camera,
        wrist_from_tag_a=state.wrist_from_tag_a,
        tcp_in_wrist=frozen_array(state.tcp_in_wrist, 3),
        base_from_object=state.base_from_object,
        camera_from_tag_b=state.camera_from_tag_b,
        camera_from_axis=state.camera_from_axis,
        axis=basis.layout.axis,
        moves=basis.layout.object_motions,
        covariance=_frozen(basis.covariance[:n, :n]),
        undetermined=_frozen(basis.undetermined[:n]),
        arm=ArmKnowledge(
            arm.model,
            _frozen(arm.flange_at),
            _frozen(arm.score),
            _frozen(arm.by_unknowns[:, :n]),
            _frozen(arm.information),
        ),
    )


def _frozen(array: Array) -> Array:
    return frozen_array(array, *array.shape)


def _arm_knowledge(result: JointResult) -> ArmKnowledge:
    model, n = result.data.arm, result.layout.size
    if model.field_mm == 0:
        nothing = np.zeros((0, 0))
        return ArmKnowledge(model, np.zeros((0, 3)), np.zeros(0), np.zeros((0, n)), nothing)
    by = whiten_arm(result.arm_factor, result.J_deviations)
    k = len(by)
    return ArmKnowledge(
        model,
        result.data.flange_at,
        by.T @ result.whitened[:k],
        by.T @ result.jacobian[:k],
        by.T @ by,
    )
