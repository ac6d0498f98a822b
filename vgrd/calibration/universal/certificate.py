"""Proof that a universal calibration is the global optimum of Eq. 8, not just a local one."""

from vgrd.geometry import Array
from vgrd.geometry.rotation_relaxation import Certificate, prove, relax


def certify_rotation(C: Array, R_X: Array) -> Certificate:
    """How far the cost at a stationary X of Eq. 7 lies above what any X could reach.

    C: (10, 10), K^T K of the reduced cost K; R_X: rotation of X. In closed form if that proves it.
    """
    quick = prove(C, R_X.T)
    return quick if quick.tight else prove(C, R_X.T, relax(C).slack)
