"""First values of what touches tell: the object, the TCP, targets without CAD."""

from dataclasses import replace

import numpy as np

from vgrd.calibration.joint.problem import Indices, JointData
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose, nearest_rotation

_UNIVERSAL_TOUCHES = 4  # what the universal method needs
_LINEAR_RCOND = 1e-6  # directions that no sample tells apart from rounding


def turned_back(data: JointData, base_from_camera: Pose, camera_from_tag_b: Pose) -> JointData:
    """Touches of the turned object as if the arm had been turned back with it, by the pictures of tag B."""
    rotations, translations = data.touches.rotations.copy(), data.touches.translations.copy()
    spins, base_from_tag_b = data.spins.poses(), base_from_camera @ camera_from_tag_b
    for i in np.flatnonzero(data.touch_spins >= 0):
        turned = base_from_camera @ spins[data.touch_spins[i]]
        back = base_from_tag_b @ turned.inverse()
        rotations[i], translations[i] = back.rotation @ rotations[i], back @ translations[i]
    touches = replace(data.touches, rotations=rotations, translations=translations)
    return replace(data, touches=touches)


def guess_object(data: JointData) -> tuple[Pose | None, Array, bool]:
    """base_from_object, TCP, and whether touches alone tell the TCP.

    base_from_object: None where no touched target is in CAD.
    """
    touches, points = data.touches, data.points
    in_cad = np.flatnonzero(data.bare_of < 0)
    of_cad = touches if len(in_cad) == len(touches) else touches.subset(in_cad)
    if len(in_cad) >= _UNIVERSAL_TOUCHES and _axes(of_cad) is Axes.MANY:
        try:
            result = calibrate_universal(UniversalProblem(data.cad[in_cad], of_cad))
        except CalibrationError:
            pass
        else:
            return result.object_from_base.inverse(), result.tcp_in_wrist, True
    pose, tcp = linear_start(touches.rotations, touches.translations, data.cad, data.bare_of)
    known = pose if len(in_cad) else None
    if any(_axes(touches.subset(own)) is not Axes.NONE for own in _of_one_place(data)):
        return known, tcp, True
    if len(points) and _axes(points) is Axes.MANY:
        point_tcp = linear_start(points.rotations, points.translations, 0 * points.translations)[1]
        shift = touches.rotations[0] @ (point_tcp - tcp)
        moved = None if known is None else Pose(pose.rotation, pose.translation + shift)
        return moved, point_tcp, True
    return known, tcp, False


def guess_bare(data: JointData, tcp_in_wrist: Array) -> Array:
    """Places (b, 3) of the targets without CAD: where the tips were, by a known TCP."""
    tips = data.touches.rotations @ tcp_in_wrist + data.touches.translations
    places = [
        tips[data.bare_of == i].mean(axis=0) if (data.bare_of == i).any() else np.zeros(3)
        for i in range(len(data.bare))
    ]
    return np.array(places).reshape(-1, 3)


def _axes(touches: TouchSet) -> Axes:
    return turned_axes(list(touches.rotations))[0]


def _of_one_place(data: JointData) -> list[Indices]:
    """Touches that compare with each other: those in CAD, and those of each target without."""
    groups = [np.flatnonzero(data.bare_of == i) for i in range(-1, len(data.bare))]
    return [group for group in groups if len(group)]


def linear_start(
    rotations: Array, translations: Array, points: Array, bare_of: Indices | None = None
) -> tuple[Pose, Array]:
    """(H, y) with `rotations @ y + translations ~ H points`, for any set of wrist orientations.

    Linear in y, the matrix of H and its translation; of what is not determined the shortest is
    taken. rotations (n, 3, 3), translations and points (n, 3), mm. bare_of: (n,) number of a place of
    its own that counts instead of the point, -1 for the point; None: the points count.
    """
    n = len(rotations)
    bare_of = np.full(n, -1) if bare_of is None else bare_of
    own = np.equal.outer(bare_of, np.arange(bare_of.max() + 1)).astype(np.float64)
    places = -np.einsum("nb,ij->nibj", own, np.eye(3)).reshape(n, 3, -1)
    known = bare_of < 0
    points = points[known] if known.any() else np.zeros((1, 3))
    middle, middle_of_flange = points.mean(axis=0), translations.mean(axis=0)
    reach = max(float(np.std(points)), 1.0)
    A = np.zeros((n, 3, 15))
    A[:, :, :3], A[known, :, 12:] = rotations, -np.eye(3)
    for row in range(3):
        A[known, row, 3 + 3 * row : 6 + 3 * row] = -(points - middle) / reach
    right = -(translations - middle_of_flange).ravel()
    M = np.concatenate([A, places], axis=2).reshape(3 * n, -1)
    x = np.linalg.lstsq(M, right, rcond=_LINEAR_RCOND)[0]
    R = nearest_rotation(x[3:12].reshape(3, 3), tolerance=np.inf)
    B = np.concatenate([M[:, :3], M[:, 12:]], axis=1)
    by_points = np.zeros((n, 3))
    by_points[known] = (points - middle) @ R.T
    x = np.linalg.lstsq(B, by_points.ravel() + right, rcond=_LINEAR_RCOND)[0]
    return Pose(R, x[3:6] + middle_of_flange - R @ middle), np.asarray(x[:3])
