"""The certified universal method: never a wrong optimum, always proven, and what the proof costs.

Problems: m touches in {4, 5, 6, 8}, planar and spatial targets, wrists turned by up to 10, 30, 60 and 180
degrees, the paper's noise; 500 of each of the 32 kinds. Peer of the time: the best of 40 random starts, TCP
and translation eliminated, each refined by `scipy.optimize.least_squares(method="lm")`.
"""

import itertools
import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm

from tests.benchmarks.harness import Row, ratio_of
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import (
    Equations,
    UniversalProblem,
    calibrate_universal,
    retract,
)
from vgrd.calibration.universal.problem import State
from vgrd.errors import NotObservable
from vgrd.geometry.least_squares import minimize

KINDS = tuple(itertools.product((4, 5, 6, 8), (False, True), (10, 30, 60, 180)))
EACH = 500
TIMED = 8
ROUNDS = 3
STARTS = 40
SIGMA_MM = 0.233
LIMIT_MM = 0.7
TIGHT = 1e-6
FASTER = 40.0
SAME = 1e-6


def problem(
    rng: np.random.Generator, m: int, planar: bool, spread_deg: float
) -> tuple[UniversalProblem, State]:
    """Touches with the paper's noise, and the truth."""
    p = rng.uniform(-150, 150, (m, 3)) * (1, 1, not planar)
    X = Rotation.random(random_state=rng).as_matrix()
    t, tcp = rng.uniform(-500, 500, 3), rng.uniform((-100, -100, 50), (100, 100, 250))
    angles = rng.uniform(-spread_deg, spread_deg, (m, 3))
    wrists = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    limit = LIMIT_MM / SIGMA_MM
    noise = truncnorm.rvs(-limit, limit, scale=SIGMA_MM, size=(m, 3), random_state=rng)
    sigma = np.full(m, SIGMA_MM)
    touches = TouchSet(wrists, (p - t) @ X - wrists @ tcp, np.array([0.0, 0.0, 1.0]), sigma, sigma)
    return UniversalProblem(p + noise, touches), (X, t, tcp)


def rows() -> Iterator[Row]:
    """universal_wrong_optima, universal_worst_gap, certified_vs_40_starts."""
    yield from _optima()
    yield _times()


def _optima() -> list[Row]:
    rng = np.random.default_rng(9)
    wrong, refused, gaps = 0, 0, []
    for kind in KINDS:
        for _ in range(EACH):
            touched, truth = problem(rng, *kind)
            try:
                found = calibrate_universal(touched)
            except NotObservable:
                refused += 1
                continue
            equations = Equations(touched.points_in_object, touched.touches)
            near_truth = minimize(equations.linearize, retract, truth).report.cost
            wrong += found.report.cost > near_truth * (1 + SAME)
            gaps.append(found.certificate.gap)
    note = f"{len(gaps)} problems of {len(KINDS)} kinds; {refused} more refused as not determined"
    return [
        Row.at_most("universal_wrong_optima", wrong, "", 0, note),
        Row.at_most("universal_worst_gap", max(gaps), "", TIGHT, f"median {np.median(gaps):.0e}"),
    ]


def _times() -> Row:
    rng = np.random.default_rng(10)
    kinds = [KINDS[i] for i in rng.permutation(len(KINDS))[:TIMED]]
    problems = [problem(rng, *kind)[0] for kind in kinds]
    rotations = Rotation.random(STARTS, random_state=11).as_matrix()

    def seconds(
        solve: Callable[[UniversalProblem], object], each: list[UniversalProblem]
    ) -> float:
        start = time.perf_counter()
        for one in each:
            solve(one)
        return (time.perf_counter() - start) / len(each)

    def ours() -> float:
        return seconds(calibrate_universal, problems)

    def scipys() -> float:
        return seconds(lambda one: [_scipy(one, R) for R in rotations], problems)

    def gauss_newtons() -> float:
        return seconds(lambda one: [_gauss_newton(one, R) for R in rotations], problems)

    share, ours_s, scipy_s = ratio_of(ours, scipys, ROUNDS)
    own = 1 / ratio_of(ours, gauss_newtons, ROUNDS)[0]
    note = (
        f"{1e3 * ours_s:.1f} ms against {1e3 * scipy_s:.0f} ms; {own:.0f} x faster than {STARTS} "
        "starts of our own Gauss-Newton"
    )
    return Row.at_least("certified_vs_40_starts", 1 / share, "x faster", FASTER, note)


def _scipy(each: UniversalProblem, R_X: np.ndarray) -> float:
    """Cost that scipy reaches from a rotation of X, Eq. 12 with a rotation vector on its left."""
    p, touches = each.points_in_object, each.touches
    R, t, tcp = Equations(p, touches).start(R_X)

    def residuals(x: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(x[:3]).as_matrix() @ R
        tips = touches.rotations @ x[6:] + touches.translations
        return ((p - (tips @ turn.T + x[3:6])) / SIGMA_MM).ravel()

    return float(least_squares(residuals, np.concatenate([np.zeros(3), t, tcp]), method="lm").cost)


def _gauss_newton(each: UniversalProblem, R_X: np.ndarray) -> float:
    """The same with our own solver."""
    equations = Equations(each.points_in_object, each.touches)
    return minimize(equations.linearize, retract, equations.start(R_X)).report.cost
