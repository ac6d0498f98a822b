"""Whether a plane or a radius that was stated is the one that the touches find by themselves."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from vgrd.calibration.observability import noise_scale
from vgrd.calibration.tcp.plane import Plane, across
from vgrd.calibration.tcp.sphere import Sphere
from vgrd.calibration.tcp.surface import SurfaceResult
from vgrd.calibration.touches import TouchSet
from vgrd.geometry import Array
from vgrd.geometry.covariance import covariance_from


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceDifference:
    """found less stated: (n,) with sigmas (n,) as the touches scatter; chance: of so much by their noise alone.

    Of a plane: mm along the stated normal where it was touched, and two tilts in rad. Of a ball: mm of radius.
    """

    found_less_stated: Array
    sigmas: Array
    chance: float


def plane_difference(
    fit: SurfaceResult[Plane], touches: TouchSet, stated: Plane
) -> SurfaceDifference:
    """Of the plane that these touches (m) found, some with weight 0, from the stated one."""
    n = fit.surface.normal_in_base
    n = n if n @ stated.normal_in_base >= 0 else -n
    cosine = max(float(n @ stated.normal_in_base), np.finfo(float).eps)
    y = touches.rotations @ fit.tcp_in_wrist + touches.translations
    weights = 1 / touches.sigma_along(np.broadcast_to(n, y.shape))
    middle = y[weights > 0].mean(axis=0)
    tilts = (y - middle) @ across(n).T
    J = np.column_stack([n @ touches.rotations, -np.ones(len(y)), tilts]) * weights[:, None]
    height = (stated.normal_in_base @ middle - stated.offset_mm) / cosine
    tilt = -across(n) @ stated.normal_in_base / cosine
    return _judged(np.append(height, tilt), covariance_from(J)[3:, 3:], fit)


def radius_difference(fit: SurfaceResult[Sphere], stated_mm: float) -> SurfaceDifference:
    """Of the radius that touches found from the stated one."""
    C = covariance_from(fit.jacobian)[6:, 6:]
    return _judged(np.array([fit.surface.radius_mm - stated_mm]), C, fit)


def _judged(
    difference: Array,
    covariance: Array,
    fit: SurfaceResult[Plane] | SurfaceResult[Sphere],
) -> SurfaceDifference:
    """F test with the scatter of the free fit; without any freedom all is chance."""
    C = covariance * noise_scale(fit) ** 2
    squares = float(difference @ np.linalg.solve(C, difference))
    n, freedom = len(difference), fit.degrees_of_freedom
    chance = float(fisher.sf(squares / n, n, freedom)) if freedom > 0 else 1.0
    return SurfaceDifference(difference, np.sqrt(np.diag(C)), chance)
