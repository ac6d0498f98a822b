"""Coverage: how often the truth lies in the 95 % regions that a calibration states."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence, default_rng
from scipy.special import chdtri

from vgrd.calibration.system import calibrate_system, expected_coordinate
from vgrd.geometry import Array
from vgrd.model import Plan, Policy
from vgrd.studies.drawing import COLORS, panels
from vgrd.studies.sessions import Session
from vgrd.studies.simulated_cell import COARSE, SimulatedCell
from vgrd.studies.study import Figure, Parameters, Study, Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(Plan.UNIVERSAL, looks=8, spins=10, touches=10, tilted=4)
_LEVEL = 0.95
_REGIONS = {"tcp": "TCP", "xy": "EC in xy", "z": "EC in z"}


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Squared Mahalanobis length of each error, as its chi-squared probability."""
    cell = SimulatedCell(default_rng(seed), vision=COARSE, robot_sigma_mm=parameters["arm_mm"])
    calibration = calibrate_system(_SESSION.record(cell))
    if calibration.tcp_in_wrist is None or calibration.tcp_covariance is None:
        raise AssertionError("tilted touches determine the TCP")
    request = cell.request()
    seen = request.seen.tag_b
    if seen is None:
        raise AssertionError("the simulated camera sees tag B")
    expected = expected_coordinate(calibration, request.target, seen, Policy.FIXED)
    pose = expected.base_from_wrist
    stands = pose.translation + cell.rng.normal(size=3) * cell.robot_sigma_mm
    miss = stands - cell.flange(request.target, request.angle_rad, pose.rotation)
    C = expected.position_covariance
    tcp_miss = calibration.tcp_in_wrist - cell.tcp_in_wrist
    return {
        "tcp": _square(tcp_miss, calibration.tcp_covariance),
        "xy": _square(miss[:2], C[:2, :2]),
        "z": _square(miss[2:], C[2:, 2:]),
        "u95": float(np.linalg.norm(miss)) / expected.u95_mm,
    }


def _square(error: Array, covariance: Array) -> float:
    """Over the 95 % quantile: at most 1 inside of the region."""
    return float(error @ np.linalg.solve(covariance, error)) / float(
        chdtri(len(error), 1 - _LEVEL)
    )
