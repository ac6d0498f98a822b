"""Proof that a universal calibration is the global optimum of Eq. 8, not just a local one."""

from vgrd.calibration.universal.problem import UniversalProblem, checked_points
from vgrd.calibration.universal.start import reduced_cost
from vgrd.geometry import Array, Pose
from vgrd.geometry.rotation_relaxation import Certificate, prove, relax


def certify(problem: UniversalProblem, object_from_base: Pose) -> Certificate:
    """How far the cost at a stationary X of Eq. 7 lies above what any X could reach.

    The TCP and the translation are the best ones for the rotation of `object_from_base`. Raises
    InputError or TooFewObservations.
    """
    K = reduced_cost(checked_points(problem), problem.touches)
    return certify_rotation(K.T @ K, object_from_base.rotation)


def certify_rotation(C: Array, R_X: Array) -> Certificate:
    """The same for a reduced cost (10, 10) and a rotation of X: in closed form if that proves it."""
    quick = prove(C, R_X.T)
    return quick if quick.tight else prove(C, R_X.T, relax(C).slack)
