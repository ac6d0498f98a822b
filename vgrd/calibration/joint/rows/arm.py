"""The arm in the rows: how they move with its deviation where it stood."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint.problem import EvidenceKind, Indices, JointData
from vgrd.calibration.joint.rows.tags import displaced_by, predicted_tag_a, seen_residuals
from vgrd.calibration.joint.state import JointState
from vgrd.geometry import Array, hat
from vgrd.model.arm import ArmModel


@dataclass(frozen=True, slots=True, eq=False)
class ArmRows:
    """Rows (k) that feel the arm: derivative (k, 6) by its deviation (mm, rad) where it stood.

    stations: (k,), which of the stands of `JointData.flange_at` that is.
    """

    by_deviation: Array
    stations: Indices

    def jacobian(self, stands: int) -> Array:
        """Derivative (k, 6 s) by the deviations at all stands (s)."""
        G = np.zeros((len(self.stations), stands, 6))
        G[np.arange(len(G)), self.stations] = self.by_deviation
        return G.reshape(len(G), -1)

    def covariance(self, arm: ArmModel, flange_at: Array) -> Array:
        """(k, k): of the rows for an arm that stood at (s, 3); without matrices of all deviations."""
        scaled = self.by_deviation * arm.scales()
        prior = arm.prior(flange_at).take(self.stations, 0).take(self.stations, 1)
        out = (scaled @ scaled.T) * prior
        if arm.quantum_mm or arm.quantum_rad:
            rounded = self.by_deviation * arm.rounding()
            out += (rounded @ rounded.T) * (self.stations[:, None] == self.stations)
        return np.asarray(out)


def arm_rows(state: JointState, data: JointData) -> ArmRows:
    """How the rows of `JointData.arm_rows` move with the arm.

    The arm stands at its report shifted by the deviation and turned about the flange.
    """
    looks = data.looks
    displaced = displaced_by(state, data, EvidenceKind.HAND_EYE)
    D = seen_residuals(*predicted_tag_a(state, data), looks.tags, displaced)[1]
    D = D @ state.base_from_camera.inverse().adjoint()
    D[:, :, 3:] += D[:, :, :3] @ hat(looks.translations)
    blocks, stations = [D.reshape(-1, 6)], [np.repeat(looks.stations, 6)]
    for touches, stands in (
        (data.touches, data.touch_stations),
        (data.points, data.point_stations),
    ):
        W = touches.base_sqrt_informations()
        lever = -hat(touches.rotations @ state.tcp_in_wrist)
        blocks.append(np.concatenate([W, W @ lever], axis=2).reshape(-1, 6))
        stations.append(np.repeat(stands, 3))
    return ArmRows(np.concatenate(blocks), np.concatenate(stations))


def arm_jacobian(state: JointState, data: JointData) -> Array:
    """Derivative (rows of the arm, 6 s) of the residuals by a deviation (mm, rad) at every stand."""
    return arm_rows(state, data).jacobian(len(data.flange_at))
