"""Circular holes of the object, measured in a plane that a tag gives: p_f and every CAD hole.

The centre of a circle does not project to the centre of its image (0.4 px at a tilt of 20 degrees), so
the rim is fitted as a circle of the plane (`vgrd.vision.holes.rim`). A Hough transform of the rectified
surroundings gives the start. What is not there, half hidden or ambiguous raises HoleNotSeen: nothing is
guessed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vgrd.devices import Pixels
from vgrd.errors import HoleNotSeen, InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import frozen_array
from vgrd.vision.holes.rim import Rim, measure_rim
from vgrd.vision.holes.seed import circles_near, rims_around
from vgrd.vision.holes.view import Circle, Outline, PlaneView, on_circle, turn_angles

RIM_HEIGHT_SIGMA_MM = 0.02  # assumed: a caliper's error; at a tilt of 20 degrees 0.007 mm
RADIUS_TOLERANCE = 0.15  # of the radius; a hole 20 % larger is another one (the test of holes)
_LEAST_RIM = 0.6  # share of the rim that must fit one circle; a guess: the widest gap leaves 0.72
_WIDEST_GAP_RAD = np.radians(100)  # of a hidden side; the rest holds the circle from three sides
_SAME_SIGN = 0.95  # of the sectors darker, or all brighter, inside; some may show a reflex
_OUTLIER_PX = 1.5  # offset of a sector that fits no circle: scratches and shades move it less
_WORST_CHI2 = 9.0  # of the sectors: three times as far from a circle as their noise
_OUTLINE_POINTS = 64  # of the fitted circle, for drawing: off by 0.1 % of the radius
_OTHER_RIM = 0.3  # contrast of a second rim against the first's; a guess: reflexes have less
_FREE_SEARCH_RADII = 8  # around the plane's origin, if no place is given; a guess
_PICTURE_MARGIN_PX = 2.0  # of the rim to the picture's edge: its blur
_SAME_HOLE_RADII = 0.1  # between the centres of rims that are one; two holes are two radii apart


@dataclass(frozen=True, slots=True, eq=False)
class HoleObservation:
    """A hole in one picture.

    center_px (2,): projection of the circle's centre (not the centre of its image); pixel_covariance
    (2, 2), px^2, of the rim alone. center_in_plane (2,) mm and covariance (2, 2) mm^2, which holds rim,
    rim height and the plane's pose. radius_mm with radius_sigma_mm. rim: share of the rim that was used;
    chi2: of the rim's sectors per degree of freedom; findings: sentences for the operator. outline_px
    (m, 2): image of the fitted circle; rim_px (n, 2): edges of the sectors that were used.
    """

    center_px: Array
    pixel_covariance: Array
    center_in_plane: Array
    covariance: Array
    radius_mm: float
    radius_sigma_mm: float
    rim: float
    chi2: float
    blur_px: float
    outline_px: Array
    rim_px: Array
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class HoleSpec:
    """A hole in CAD: its centre (3,) in the object, mm, on the rim's plane; radius."""

    point_in_object: Array
    radius_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class HoleSighting:
    """A hole by its target's name; pixel (2,) and the sigma of each coordinate."""

    target: str
    pixel: Array
    sigma_px: float
    hole: HoleObservation


def find_hole(
    grey: Pixels,
    camera: CameraModel,
    camera_from_plane: Pose,
    radius_mm: float,
    center_guess_in_plane: Array | None = None,
    *,
    search_mm: float | None = None,
    rim_height_mm: float = 0.0,
    rim_height_sigma_mm: float = RIM_HEIGHT_SIGMA_MM,
    plane_covariance: Array | None = None,
) -> HoleObservation:
    """Measure one hole of known radius in a grey picture (h, w).

    camera_from_plane: of a tag, z into the paper; the rim is rim_height_mm above it, toward the
    camera. The centre is looked for within search_mm (one radius) of the guess, without a guess within
    8 radii of the plane's origin. plane_covariance: (6, 6) of a left tangent perturbation, exact
    without. Raises HoleNotSeen with the reason, InputError for a radius that is not positive.
    """
    if not radius_mm > 0:
        raise InputError(f"the radius of a hole must be above 0, not {radius_mm:g} mm")
    guess = np.zeros(2) if center_guess_in_plane is None else np.asarray(center_guess_in_plane)
    reach = (_FREE_SEARCH_RADII if center_guess_in_plane is None else 1) * radius_mm
    reach = search_mm or reach
    raised = _raised(camera_from_plane, rim_height_mm)
    view = PlaneView(grey, camera, raised)
    is_inside = view.fits(Circle(guess, radius_mm), _PICTURE_MARGIN_PX)
    if not is_inside and center_guess_in_plane is not None:
        raise HoleNotSeen("the hole is at the edge of the picture or outside: move the camera")
    rim = _only_one(view, Circle(guess, radius_mm), reach)
    findings = _second_rim(view, rim, radius_mm)
    return _observation(
        view, camera, camera_from_plane, rim,
        (rim_height_mm, rim_height_sigma_mm), plane_covariance, findings,
    )  # fmt: skip


def sight_holes(
    grey: Pixels,
    camera: CameraModel,
    camera_from_tag_b: Pose,
    object_from_tag_b: Pose,
    holes: Mapping[str, HoleSpec],
    *,
    search_mm: float | None = None,
) -> tuple[list[HoleSighting], dict[str, str]]:
    """Look for the object's CAD holes in a picture in which tag B was seen.

    Returns the sightings for the joint estimate, and by name why the other holes were not measured.
    Every rim's plane is parallel to the tag's, through the hole's own CAD point.
    """
    sightings, missing = [], {}
    tag_b_from_object = object_from_tag_b.inverse()
    for name, hole in holes.items():
        x, y, z = tag_b_from_object.apply(hole.point_in_object)
        try:
            observation = find_hole(
                grey, camera, camera_from_tag_b, hole.radius_mm, np.array([x, y]),
                search_mm=search_mm, rim_height_mm=-z,
            )  # fmt: skip
        except HoleNotSeen as reason:
            missing[name] = str(reason)
            continue
        sigma = float(np.sqrt(np.trace(observation.pixel_covariance) / 2))
        sightings.append(HoleSighting(name, observation.center_px, sigma, observation))
    return sightings, missing


def _only_one(view: PlaneView, expected: Circle, reach_mm: float) -> Rim:
    """The one rim within reach; HoleNotSeen tells why there is none, or that there are several."""
    rims: list[Rim] = []
    reasons = []
    for start in circles_near(view, expected, reach_mm, RADIUS_TOLERANCE):
        rim = measure_rim(view, start)
        reason = _reason_against(rim, expected, reach_mm)
        if rim is None or reason:
            reasons.append(reason)
        elif all(_distance_mm(rim, other) > _SAME_HOLE_RADII * expected.radius for other in rims):
            rims.append(rim)
    if len(rims) > 1:
        raise HoleNotSeen(
            f"{len(rims)} holes of this size are within {reach_mm:.3g} mm of where it should be: "
            "give a better place or a smaller search"
        )
    if not rims:
        raise HoleNotSeen(reasons[0] if reasons else "no circle is where the hole should be")
    return rims[0]


def _reason_against(rim: Rim | None, expected: Circle, reach_mm: float) -> str:
    """Why a rim is not the hole's, empty when it is."""
    if rim is None:
        return "no rim is where the hole should be"
    is_outlier = np.abs(rim.offsets_px) > max(_OUTLIER_PX, rim.blur_px)
    good = (rim.weights > 0) & np.isfinite(rim.sigmas_px) & ~is_outlier
    share = float(good.mean())
    if share < _LEAST_RIM or _widest_gap(good) > _WIDEST_GAP_RAD:
        return f"only {share:.0%} of the rim fits one circle: the hole is partly hidden"
    sign = np.sign(rim.contrast[good])
    if max((sign > 0).mean(), (sign < 0).mean()) < _SAME_SIGN:
        return "the rim is dark on one side and bright on the other: change the light"
    if abs(rim.circle.radius / expected.radius - 1) > RADIUS_TOLERANCE:
        return f"a circle of {rim.circle.radius:.2f} mm radius is there, expected {expected.radius:.2f}"
    if np.linalg.norm(rim.circle.centre - expected.centre) > reach_mm:
        return f"no hole is within {reach_mm:.3g} mm of where it should be"
    if rim.chi2 > _WORST_CHI2:
        return f"the rim is no circle (chi-square {rim.chi2:.1f} per freedom): clean or light it"
    return ""


def _second_rim(view: PlaneView, rim: Rim, radius_mm: float) -> tuple[str, ...]:
    """Findings about other rims around the same centre; HoleNotSeen when two have the given radius."""
    radii = [radius for radius, share in rims_around(view, rim.circle) if share > _OTHER_RIM]
    for radius in radii:
        if abs(radius / radius_mm - 1) <= RADIUS_TOLERANCE:
            raise HoleNotSeen(
                f"the hole has two rims, of {rim.circle.radius:.2f} and {radius:.2f} mm radius, "
                f"and {radius_mm:.2f} mm is near both: give the radius of the one that counts"
            )
    return tuple(f"a second rim of {radius:.2f} mm radius (chamfer) is around" for radius in radii)


def _observation(
    view: PlaneView,
    camera: CameraModel,
    camera_from_plane: Pose,
    rim: Rim,
    height: tuple[float, float],
    plane_covariance: Array | None,
    findings: Sequence[str],
) -> HoleObservation:
    centre, rim_covariance = rim.circle.centre, rim.covariance[:2, :2]
    pixels, J = view.image_of(centre[None])
    ray = np.append(camera.normalize(pixels)[0], 1.0)
    J_height = _derivative(
        lambda h: _on_plane(_raised(camera_from_plane, height[0] + float(h[0])), ray), 1
    )
    total = rim_covariance + height[1] ** 2 * J_height @ J_height.T
    if plane_covariance is not None:
        J_pose = _derivative(
            lambda xi: _on_plane(_raised(Pose.exp(xi) @ camera_from_plane, height[0]), ray), 6
        )
        total = total + J_pose @ plane_covariance @ J_pose.T
    return HoleObservation(
        center_px=frozen_array(pixels[0], 2),
        pixel_covariance=frozen_array(J[0] @ rim_covariance @ J[0].T, 2, 2),
        center_in_plane=frozen_array(centre, 2),
        covariance=frozen_array(total, 2, 2),
        radius_mm=rim.circle.radius,
        radius_sigma_mm=float(np.sqrt(rim.covariance[2, 2])),
        rim=float((rim.weights > 0).mean()),
        chi2=rim.chi2,
        blur_px=rim.blur_px,
        outline_px=view.image_of(on_circle(rim.circle, turn_angles(_OUTLINE_POINTS)))[0],
        rim_px=_edges_of(view, rim),
        findings=tuple(findings),
    )


def _edges_of(view: PlaneView, rim: Rim) -> Array:
    """Pixels (n, 2) of the edges of the sectors that belong to the circle."""
    inliers = rim.weights > 0
    angles = turn_angles(len(inliers))[inliers]
    outline = Outline.of(view, rim.circle)
    edges = outline.at(angles) + rim.offsets_px[inliers] * outline.normals(angles)
    return np.column_stack([edges.real, edges.imag])


def _derivative(
    function: Callable[[Array], Array],
    n: int,
    step: float = 1e-6,  # mm, rad: rounding leaves seven digits, curvature more
) -> Array:
    """Derivative (2, n) of a function (n,) -> (2,) at zero, by central differences."""
    columns = [(function(step * axis) - function(-step * axis)) / (2 * step) for axis in np.eye(n)]
    return np.stack(columns, -1)


def _raised(camera_from_plane: Pose, height_mm: float) -> Pose:
    """The plane of the rim: shifted against z, which points into the paper."""
    return camera_from_plane @ Pose(np.eye(3), np.array([0.0, 0.0, -height_mm]))


def _on_plane(camera_from_plane: Pose, ray: Array) -> Array:
    """Where a ray (3,) meets a plane, (2,) in the plane."""
    R, t = camera_from_plane.rotation, camera_from_plane.translation
    x, y, z = np.linalg.solve(np.column_stack([R[:, 0], R[:, 1], t]), ray)
    return np.array([x / z, y / z])


def _distance_mm(rim: Rim, other: Rim) -> float:
    """Between the centres of two rims."""
    return float(np.linalg.norm(rim.circle.centre - other.circle.centre))


def _widest_gap(good: NDArray[np.bool_]) -> float:
    """Largest angle between neighbouring sectors (k,) that are good, rad."""
    indices = np.flatnonzero(good)
    if indices.size == 0:
        return 2 * np.pi
    gaps = np.diff(np.append(indices, indices[0] + len(good)))
    return float((gaps.max() - 1) * 2 * np.pi / len(good))
