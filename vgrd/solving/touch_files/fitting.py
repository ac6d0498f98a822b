"""The fit of each kind of touches, robust, and with the level of noise that the touches show."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.stats import norm

from vgrd.calibration.levels import Level, Levels, wider_by_freedom
from vgrd.calibration.observability import RobustFit, fit_without_outliers, noise_scale
from vgrd.calibration.tcp import (
    AxisPoint,
    FixedPointResult,
    SurfaceResult,
    ToolOrientation,
    TouchRows,
    by_kind,
    calibrate_fixed_point,
    check_one_plane,
    check_one_sphere,
    find_touch_levels,
    fit_plane,
    fit_sphere,
    freedom_of_unknowns,
    grouped_covariance,
    named_levels,
    point_rows,
    surface_rows,
    tool_orientation,
    touch_kinds,
    with_levels,
)
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import (
    UniversalProblem,
    UniversalResult,
    calibrate_universal,
)
from vgrd.geometry import Array, Pose
from vgrd.geometry.covariance import dimensions_of, radius95
from vgrd.geometry.rotation_relaxation import Certificate
from vgrd.judging.thresholds import OUTLIER_SIGMA
from vgrd.solving.touch_files.document import TouchFile, TouchKind

PlainFit = FixedPointResult | UniversalResult | SurfaceResult[Any]

_CLOSED_FORM = Certificate(0.0, tight=True)
_FALSELY_BAD = 5e-3  # touches per good file, however long it is
_ALIKE = 2.0  # times the radius by single touches: of 16 groups chance makes 1.7 in 100 files
_ROUNDS = 2  # of fit and levels: bad touches are told by the levels, and these by the others
_FIXED_POINT = slice(0, 3)  # columns of the TCP in the fit of a point, a plane and a ball
_UNIVERSAL = slice(6, 9)  # the same of the universal method


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What the kinds have in common; misses_mm: (m,); covariance: (3, 3) of the TCP.

    rows: whitened, of the touches in use; tcp_columns: of their Jacobian. point_in_base: (3,), fixed point only,
    and the covariance (6, 6) of TCP and point.
    """

    fit: RobustFit[Any]
    tcp_in_wrist: Array
    covariance: Array
    misses_mm: Array
    rows: TouchRows
    tcp_columns: slice
    object_from_base: Pose | None = None
    certificate: Certificate | None = _CLOSED_FORM
    point_in_base: Array | None = None
    covariance_with_point: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Levelled:
    """An estimate with the levels that its touches show.

    touches: with the found sigmas. stated_scale: scatter over what the stated sigmas promise. wider: factor by which
    the spread of the levels widens a sigma's 95 %, in the covariance already. alike: errors are shared by touches of
    like orientation, and the covariance is the one by groups of these.
    """

    estimate: Estimate
    touches: TouchSet
    levels: tuple[Level, ...]
    stated_scale: float
    wider: float
    alike: bool

    @property
    def rms_mm(self) -> float:
        """Of the misses of the touches in use."""
        return float(np.sqrt(np.mean(self.estimate.misses_mm[self.estimate.fit.used] ** 2)))


def fit_touches(file: TouchFile) -> Estimate:
    """TCP by the sigmas as they stand, bad touches left out.

    Raises TooFewObservations, NotObservable (names the missing motion) or DidNotConverge.
    """
    return _FITS[file.kind](file)


def fit_with_levels(file: TouchFile) -> Levelled:
    """TCP with the sigmas that the touches show, those of the file being their prior.

    Raises as `fit_touches`.
    """
    kinds = touch_kinds(file.touches, np.array(file.sigma_given))
    estimate = fit_touches(file)
    stated_scale = noise_scale(estimate.fit.result)
    levels = Levels.stated(len(kinds))
    levelled = file
    for _ in range(_ROUNDS):
        rows = by_kind(estimate.rows, kinds)
        levels = find_touch_levels(rows, kinds, estimate.fit.used, levels.log_variances)
        levelled = replace(file, touches=with_levels(file.touches, kinds, levels.scales))
        estimate = fit_touches(levelled)
    rows = by_kind(estimate.rows, kinds)
    used = estimate.fit.used
    freedom = freedom_of_unknowns(rows, used, levels, estimate.tcp_columns)
    wider = wider_by_freedom(freedom, dimensions_of(estimate.covariance))
    with_point = estimate.covariance_with_point
    covariance = estimate.covariance * wider**2
    grouped = grouped_covariance(rows, used, file.touches.rotations, estimate.tcp_columns)
    alike = grouped is not None and radius95(grouped) > _ALIKE * radius95(covariance)
    estimate = replace(
        estimate,
        covariance=grouped if alike and grouped is not None else covariance,
        covariance_with_point=None if with_point is None else with_point * wider**2,
    )
    return Levelled(
        estimate, levelled.touches, named_levels(levels, kinds), stated_scale, wider, alike
    )


def plain_fit(file: TouchFile, weights: Array | None = None) -> PlainFit:
    """Fit by the sigmas as they stand, no touch left out; weights (m,) of the touches, 1 by default."""
    touches = file.touches if weights is None else file.touches.weighted(weights)
    if file.kind is TouchKind.UNIVERSAL:
        return calibrate_universal(UniversalProblem(file.points_in_object, touches))
    if file.kind is TouchKind.PLANE:
        return fit_plane(touches, file.plane)
    if file.kind is TouchKind.SPHERE:
        return fit_sphere(touches, file.radius_mm)
    return calibrate_fixed_point(touches)


def rows_of(file: TouchFile, fit: PlainFit) -> TouchRows:
    """Rows of a `plain_fit`, across and along the tool."""
    if isinstance(fit, SurfaceResult):
        return surface_rows(file.touches, fit.whitened, fit.jacobian, fit.normals_in_base)
    turns, sign = np.broadcast_to(np.eye(3), file.touches.rotations.shape), -1
    if isinstance(fit, UniversalResult):
        sign = 1
        if file.touches.is_isotropic:  # then the rows stand in the frame of the object
            R_X = fit.object_from_base.rotation
            turns = np.swapaxes(file.touches.rotations, 1, 2) @ R_X.T
    return point_rows(file.touches, fit.whitened, fit.jacobian, turns, sign)


def find_orientation(file: TouchFile, levelled: Levelled) -> ToolOrientation | None:
    """Orientation of the tool, where the file has poses for it; raises NotObservable where they do not tell it."""
    estimate = levelled.estimate
    point, covariance = estimate.point_in_base, estimate.covariance_with_point
    if not file.axis_poses or point is None or covariance is None:
        return None
    sigma = levelled.wider * max(level.found for level in levelled.levels)
    spread = sigma**2 * np.eye(3)
    points = [
        AxisPoint(pose, "xyz".index(axis[1]), 1 if axis[0] == "+" else -1, spread)
        for axis, pose in file.axis_poses
    ]
    return tool_orientation(points, estimate.tcp_in_wrist, point, covariance)


def _universal(file: TouchFile) -> Estimate:
    fit = _robust(file)
    best: UniversalResult = fit.result
    X = best.object_from_base
    return Estimate(
        fit,
        best.tcp_in_wrist,
        best.covariance[6:, 6:],
        _measured_mm(file.touches, best.residuals_mm @ X.rotation),
        rows_of(file, best),
        _UNIVERSAL,
        X,
        best.certificate,
    )


def _fixed_point(file: TouchFile) -> Estimate:
    fit = _robust(file)
    best: FixedPointResult = fit.result
    return Estimate(
        fit,
        best.tcp_in_wrist,
        best.covariance[:3, :3],
        _measured_mm(file.touches, best.residuals_mm),
        rows_of(file, best),
        _FIXED_POINT,
        point_in_base=best.point_in_base,
        covariance_with_point=best.covariance,
    )


def _plane(file: TouchFile) -> Estimate:
    fit = _robust(file)
    best = fit.result
    check_one_plane(best)
    proof = _CLOSED_FORM if file.plane else None
    return Estimate(
        fit,
        best.tcp_in_wrist,
        best.covariance,
        np.abs(best.residuals_mm),
        rows_of(file, best),
        _FIXED_POINT,
        certificate=proof,
    )


def _sphere(file: TouchFile) -> Estimate:
    fit = _robust(file)
    best = fit.result
    check_one_sphere(best)
    return Estimate(
        fit,
        best.tcp_in_wrist,
        best.covariance,
        np.abs(best.residuals_mm),
        rows_of(file, best),
        _FIXED_POINT,
        certificate=None,
    )


_FITS: Mapping[TouchKind, Callable[[TouchFile], Estimate]] = MappingProxyType(
    {
        TouchKind.UNIVERSAL: _universal,
        TouchKind.FIXED_POINT: _fixed_point,
        TouchKind.PLANE: _plane,
        TouchKind.SPHERE: _sphere,
    }
)


def _robust(file: TouchFile) -> RobustFit[Any]:
    count = len(file.names)
    limit = max(OUTLIER_SIGMA, float(norm.isf(_FALSELY_BAD / (2 * count))))
    return fit_without_outliers(lambda weights: plain_fit(file, weights), count, limit)


def _measured_mm(touches: TouchSet, errors_in_base: Array) -> Array:
    """Length (m,) of errors (m, 3), directions that were not measured left out."""
    errors = np.einsum("mij,mj->mi", touches.measured().base_sqrt_informations(), errors_in_base)
    return np.asarray(np.linalg.norm(errors, axis=1))
