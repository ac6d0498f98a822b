"""The arm in the rows: how they move with its deviation where it stood."""

import numpy as np

from vgrd.calibration.joint.problem import EvidenceKind, Indices, JointData
from vgrd.calibration.joint.rows.tags import displaced_by, predicted_tag_a, seen_residuals
from vgrd.calibration.joint.state import JointState
from vgrd.geometry import Array, hat

_EYE = np.eye(3)


def arm_jacobian(state: JointState, data: JointData) -> Array:
    """Derivative (rows of the arm, 6 s) of the residuals by a deviation (mm, rad) at every stand.

    The arm stands at its report shifted by the deviation and turned about the flange.
    """
    G = np.zeros((data.arm_rows, len(data.flange_at), 6))
    X_inv = state.base_from_camera.inverse()
    looks = data.looks
    displaced = displaced_by(state, data, EvidenceKind.HAND_EYE)
    D = seen_residuals(*predicted_tag_a(state, data), looks.tags, displaced)[1] @ X_inv.adjoint()
    D[:, :, 3:] += D[:, :, :3] @ hat(looks.translations)
    _put(G, data.rows_of(EvidenceKind.HAND_EYE), D, looks.stations)
    for link, touches, stations in (
        (EvidenceKind.TOUCHES, data.touches, data.touch_stations),
        (EvidenceKind.POINTS, data.points, data.point_stations),
    ):
        lever = -hat(touches.rotations @ state.tcp_in_wrist)
        D = np.concatenate([np.broadcast_to(_EYE, lever.shape), lever], axis=2)
        _put(G, data.rows_of(link), touches.base_sqrt_informations() @ D, stations)
    return G.reshape(data.arm_rows, -1)


def _put(G: Array, rows: slice, blocks: Array, stations: Indices) -> None:
    part = G[rows].reshape(*blocks.shape[:2], *G.shape[1:])
    part[np.arange(len(blocks)), :, stations] = blocks
