"""Data of the paper's simulations (section VI-A): touches that satisfy Eq. 7, noise on the CAD points."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm

from fakes.world.noise import truncated_normal
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import Equations, UniversalProblem
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import covariance_from

SIGMA_MM = 0.233  # of the paper's touches (section VI-A)
LIMIT_MM = 0.7  # where the paper cuts them: three sigmas
NOISE_MM = float(SIGMA_MM * truncnorm.std(-LIMIT_MM / SIGMA_MM, LIMIT_MM / SIGMA_MM))
_HALF_SIZE_MM = 150.0  # of the cube of targets, a guess: 30 cm, as a fixture has
_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A problem and its truth; points_in_object (m, 3) are those without noise, mm."""

    problem: UniversalProblem
    points_in_object: Array
    object_from_base: Pose
    tcp_in_wrist: Array

    def bound_mm(self) -> float:
        """Cramer-Rao bound of the TCP's rms error, for normal noise of the same variance."""
        equations = Equations(self.points_in_object, self.problem.touches)
        X = self.object_from_base
        J = equations.linearize((X.rotation, X.translation, self.tcp_in_wrist))[1]
        return float(np.sqrt(np.trace(covariance_from(J)[6:, 6:])))


def truncated_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Normal noise of SIGMA_MM cut at LIMIT_MM, mm."""
    return SIGMA_MM * truncated_normal(rng, LIMIT_MM / SIGMA_MM, shape)


def draw(
    rng: np.random.Generator, touches: int, spread_deg: float = 180.0, *, planar: bool = False
) -> Drawn:  # 180: any orientation, as figures 4 and 5 need
    """Touches of as many points with wrists turned uniformly by up to +-spread_deg on each axis."""
    p = rng.uniform(-_HALF_SIZE_MM, _HALF_SIZE_MM, (touches, 3)) * (1, 1, 0 if planar else 1)
    X = Pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-500, 500, 3))
    tcp = rng.uniform((-100, -100, 50), (100, 100, 250))
    angles = rng.uniform(-spread_deg, spread_deg, (touches, 3))
    R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    t = (X.inverse() @ p) - R @ tcp
    sigma = np.full(touches, NOISE_MM)
    noisy = p + truncated_noise(rng, p.shape)
    problem = UniversalProblem(noisy, TouchSet(R, t, _AXIS, sigma, sigma))
    return Drawn(problem, p, X, tcp)
