"""One universal calibration against scipy's least squares on the same touches.

Ours: `calibrate_universal` whole (global starts, Gauss-Newton, rank check, covariance). Peer: one run of
`scipy.optimize.least_squares(method="lm")` on Eq. 12 from the linear solution, no check, no covariance.
"""

import time

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.benchmarks.harness import Row, ratio_of
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import Equations, UniversalProblem, calibrate_universal

PROBLEMS = 20
ROUNDS = 5
TOUCHES = 8
SIGMA_MM = 0.233
BAR = 1.0


def problem(rng: np.random.Generator) -> UniversalProblem:
    """Draw eight touches with wrists turned up to 60 degrees, the paper's noise."""
    points = rng.uniform(-150, 150, (TOUCHES, 3))
    X = Rotation.random(random_state=rng).as_matrix()
    tcp = np.array([10.0, -20.0, 150.0])
    wrists = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (TOUCHES, 3))).as_matrix()
    tips = (points + rng.normal(0, SIGMA_MM, points.shape) - 300.0) @ X
    sigma = np.full(TOUCHES, SIGMA_MM)
    touches = TouchSet(wrists, tips - wrists @ tcp, np.array([0.0, 0.0, 1.0]), sigma, sigma)
    return UniversalProblem(points, touches)


def rows() -> list[Row]:
    """universal_vs_scipy: time of ours / time of scipy's, over the same problems."""
    rng = np.random.default_rng(4)
    problems = [problem(rng) for _ in range(PROBLEMS)]

    def ours() -> float:
        start = time.perf_counter()
        for each in problems:
            calibrate_universal(each)
        return (time.perf_counter() - start) / PROBLEMS

    def scipys() -> float:
        start = time.perf_counter()
        for each in problems:
            _scipy(each)
        return (time.perf_counter() - start) / PROBLEMS

    for each in problems:
        assert np.allclose(calibrate_universal(each).tcp_in_wrist, _scipy(each), atol=1e-3)
    ratio, ours_s, scipy_s = ratio_of(ours, scipys, ROUNDS)
    note = f"{1e3 * ours_s:.1f} ms against {1e3 * scipy_s:.1f} ms, {TOUCHES} touches"
    return [Row.at_most("universal_vs_scipy", ratio, "x", BAR, note)]


def _linear_start(p: np.ndarray, touches: TouchSet) -> np.ndarray:
    """Rotation (3, 3) of X nearest to the linear solution of Eq. 7 (15 free numbers)."""
    A = np.zeros((len(p), 3, 15))
    for row in range(3):
        A[:, row, 3 * row : 3 * row + 3] = p
    A[:, :, 9:12], A[:, :, 12:] = -touches.rotations, -np.eye(3)
    S = np.linalg.lstsq(A.reshape(-1, 15), touches.translations.ravel(), rcond=None)[0][:9]
    U, _, Vt = np.linalg.svd(S.reshape(3, 3))
    return (U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt).T


def _scipy(each: UniversalProblem) -> np.ndarray:
    """TCP (3,) by scipy, Eq. 12 with a rotation vector for X."""
    p, touches = each.points_in_object, each.touches
    R, t, tcp = Equations(p, touches).start(_linear_start(p, touches))

    def residuals(x: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        tips = touches.rotations @ x[6:] + touches.translations
        return (p - (tips @ turn.T + x[3:6])).ravel()

    start = np.concatenate([Rotation.from_matrix(R).as_rotvec(), t, tcp])
    return least_squares(residuals, start, method="lm").x[6:]
