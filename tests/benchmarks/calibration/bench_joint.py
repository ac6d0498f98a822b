"""Joint solve of 30 looks, 8 touches and 10 spins against scipy's least squares.

Ours: `calibrate_joint` whole (closed-form start, Gauss-Newton, null space, covariance). Peer: one run of
`scipy.optimize.least_squares` from the same start on the same residuals, vectorised, with its own numerical
derivatives; no covariance. Both are to end at the same cost, noise being as stated. Levels of noise, found with
the unknowns, are compared with ours without them, on an arm with an error field and prints and CAD that are inexact.
"""

import time
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fakes.world.simulation import Simulation
from tests.benchmarks.harness import Row, ratio_of
from vgrd.calibration.joint.estimate import calibrate_joint
from vgrd.calibration.joint.problem import JointData, Tags
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import JointState
from vgrd.geometry import hat
from vgrd.model import ArmModel, CellFacts, Recording

ROUNDS = 3
BAR = 0.1
LEVELS_BAR = 3.0


def recording() -> Recording:
    """Session of the size that the figure names, four wrists tilted."""
    sim = Simulation(4)
    wrists = [sim.wrist()] * 4 + [sim.wrist(0.4) for _ in range(4)]
    return sim.record(looks=30, spins=10, wrists=wrists)


def rows() -> list[Row]:
    """joint_vs_scipy: time of ours / time of scipy's."""
    taught = recording()
    costs = {}

    def ours() -> float:
        start = time.perf_counter()
        costs["ours"] = calibrate_joint(taught, arm=ArmModel(), find_noise=False).cost
        return time.perf_counter() - start

    data = gather(taught, arm=ArmModel())
    first = guess(data)

    def scipys() -> float:
        start = time.perf_counter()
        costs["scipy"] = least_squares(Residuals(data), pack(first), x_scale="jac").cost
        return time.perf_counter() - start

    ratio, ours_s, scipy_s = ratio_of(ours, scipys, ROUNDS)
    assert np.isclose(costs["ours"], costs["scipy"], rtol=1e-5), costs
    note = f"{1e3 * ours_s:.0f} ms against {1e3 * scipy_s:.0f} ms, 30 looks, 8 touches, 10 spins"
    return [Row.at_most("joint_vs_scipy", ratio, "x", BAR, note), _levels()]


def _levels() -> Row:
    """joint_levels_vs_stated: time with levels and priors / time of the estimate as it was without them."""
    taught = recording()
    inexact = replace(
        taught.facts,
        object=replace(taught.facts.object, cad_sigma_mm=0.03, center_sigma_mm=0.2),
        tag_a_sigma_mm=0.05,
        tag_b_sigma_mm=0.05,
        robot_sigma_mm=0.1,
    )
    exact = replace(taught.facts, robot_sigma_mm=0.1)

    def timed(facts: CellFacts, *, find_noise: bool) -> float:
        start = time.perf_counter()
        calibrate_joint(replace(taught, facts=facts), find_noise=find_noise)
        return time.perf_counter() - start

    ratio, with_s, without_s = ratio_of(
        lambda: timed(inexact, find_noise=True), lambda: timed(exact, find_noise=False), ROUNDS
    )
    note = f"{1e3 * with_s:.0f} ms against {1e3 * without_s:.0f} ms, 30 looks, 8 touches, 10 spins"
    return Row.at_most("joint_levels_vs_stated", ratio, "x", LEVELS_BAR, note)


def pack(state: JointState) -> np.ndarray:
    """Unknowns as rotation vectors, translations, the TCP and the angles."""
    poses = [
        state.base_from_camera,
        state.wrist_from_tag_a,
        state.base_from_object,
        state.camera_from_tag_b,
        state.camera_from_axis,
    ]
    parts = [np.concatenate([pose.rotvec(), pose.translation]) for pose in poses]
    return np.concatenate([*parts, state.tcp_in_wrist, state.table_motion[:, 2]])


class Residuals:
    """The same whitened residuals as ours, isotropic touches, exact arm; no derivatives."""

    def __init__(self, data: JointData) -> None:
        self._data = data

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """All residuals at packed unknowns."""
        data = self._data
        R = Rotation.from_rotvec(x[:30].reshape(5, 6)[:, :3]).as_matrix()
        t = x[:30].reshape(5, 6)[:, 3:]
        (R_X, R_Y, R_O, R_F, R_G), (t_X, t_Y, t_O, t_F, t_G) = R, t
        tcp, angles = x[30:33], x[33:]
        looks, touches = data.looks, data.touches
        tag_a = looks.rotations @ t_Y + looks.translations
        tips = touches.rotations @ tcp + touches.translations - (data.cad @ R_O.T + t_O)
        axes = np.outer(angles, R_G[:, 2])
        turns = Rotation.from_rotvec(axes).as_matrix()
        shifts = t_G - turns @ t_G
        n = len(data.reference)
        center = (t_G - R_X.T @ (R_O @ data.center + t_O - t_X)) @ R_G[:, :2]
        return np.concatenate(
            [
                tags(R_X.T @ looks.rotations @ R_Y, (tag_a - t_X) @ R_X, looks.tags),
                (tips / touches.lateral_sigma_mm[:, None]).ravel(),
                tags(
                    np.broadcast_to(R_F, (n, 3, 3)), np.broadcast_to(t_F, (n, 3)), data.reference
                ),
                tags(turns @ R_F, turns @ t_F + shifts, data.spins),
                center / data.turntable.center_sigma_mm,
            ]
        )


def tags(R: np.ndarray, t: np.ndarray, seen: Tags) -> np.ndarray:
    """Whitened tangents of predicted against seen poses; (6 n,)."""
    turn = R @ np.swapaxes(seen.rotations, 1, 2)
    w = Rotation.from_matrix(turn).as_rotvec()
    shift = t - np.einsum("nij,nj->ni", turn, seen.translations)
    W = hat(w)
    v = np.einsum("nij,nj->ni", np.eye(3) - W / 2 + W @ W / 12, shift)
    return np.einsum("nij,nj->ni", seen.sqrt_informations, np.concatenate([v, w], axis=1)).ravel()
