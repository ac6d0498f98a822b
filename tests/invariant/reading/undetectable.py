"""What one picture cannot tell: which slips leave no trace that could be told from noise.

First principles, no code of the estimate: a picture gives two poses, of tag A and of tag B. Where the camera
stands and how the object has moved are not known before. So the errors of both poses that some camera's place and
some allowed motion explain as well are not told, and what is left of them is told where it is large against the
noise of pictures, arm and calibration.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np

from tests.invariant.simulation.pictures import Exposure
from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.teaching import Variant
from vgrd.geometry import Array, Pose, hat
from vgrd.model import Motion

TOLD_SIGMAS = 10.0  # expected misfit from which on a served answer is wrong: 5 are refused, and noise takes some
STABILITY = np.array([0.5] * 3 + [5e-4] * 3)  # mm and rad, as in the cell file
RESIDUE_MM, RESIDUE_RAD = 0.15, 4e-4  # 1 sigma of arm and calibration at a tag: a guess, generous
MEMORY_S = 60.0
_MOTIONS = {Motion.TURNTABLE: (5,), Motion.PLANAR: (0, 1, 5), Motion.FREE: (0, 1, 2, 3, 4, 5)}


def expected_misfit(
    picture: Exposure, earlier: Exposure | None, variant: Variant, plant: Plant
) -> float:
    """Sigmas by which a picture contradicts, of the reading of it that contradicts least.

    earlier: the newest picture before that shows tag A and an arm at rest, where this one may not.
    """
    motion = _motion_columns(variant.motion, picture, plant)
    e_b, W_b = picture.errors["b"], _weight(picture, "b")
    misfits = []
    for rows in _readings(picture, earlier, variant):
        r = np.concatenate([W_b @ e_b, *(r for r, _ in rows)])
        J_camera = np.vstack([W_b, *(J for _, J in rows)])
        J_motion = np.vstack([W_b @ motion, np.zeros((len(r) - 6, motion.shape[1]))])
        J = np.hstack([J_camera, J_motion])
        x = np.linalg.lstsq(J, r, rcond=None)[0]
        misfits.append(float(np.linalg.norm(r - J @ x)))
    return min(misfits)


def effect_mm(picture: Exposure, earlier: Exposure | None, point_in_camera: Array) -> float:
    """The most by which all that is wrong in a picture can shift a point (3,), mm in the camera."""
    errors = [picture.errors["b"], picture.camera_shift.log()]
    for with_tag_a in _with_tag_a(picture, earlier):
        errors.append(with_tag_a.errors["a"])
        errors.append((with_tag_a.camera_shift.inverse() @ picture.camera_shift).log())
    lever = np.hstack([np.eye(3), -hat(point_in_camera)])
    return sum(float(np.linalg.norm(lever @ error)) for error in errors)


@cache
def is_told(link: str, direction: tuple[float, ...], motion: Motion, stability: str) -> bool:
    """Whether one picture of both tags tells a slip (6,) of a link: "tag A", "tag B", "camera" or "object".

    direction: of the slip as a motion in the frame of the table, mm and rad.
    """
    plant = Plant()
    camera_from_table = plant.layout.base_from_camera.inverse() @ plant.layout.base_from_table
    slip = camera_from_table.adjoint() @ np.array(direction)
    errors = {"a": np.zeros(6), "b": np.zeros(6)}
    shift = Pose.identity()
    if link == "tag A":
        errors["a"] = slip
    elif link == "camera":
        shift = Pose.exp(slip)
    else:
        errors["b"] = slip
    picture = Exposure(0.0, {}, errors, shift, plant.base_from_object(0.0), (link,))
    return expected_misfit(picture, None, Variant(motion, stability), plant) > TOLD_SIGMAS


def _readings(
    picture: Exposure, earlier: Exposure | None, variant: Variant
) -> Iterator[list[tuple[Array, Array]]]:
    """Rows (residual, Jacobian by the camera's displacement) of each way to read where the camera is."""
    rows_of_tag_a = []
    for seen in _with_tag_a(picture, earlier):
        moved = (seen.camera_shift.inverse() @ picture.camera_shift).log()
        W = _weight(seen, "a")
        rows_of_tag_a.append((W @ (seen.errors["a"] - moved), W))
    if variant.stability == "movable":
        yield from ([rows] for rows in rows_of_tag_a)
        if not rows_of_tag_a:
            yield []
        return
    prior = (picture.camera_shift.log() / STABILITY, np.diag(1 / STABILITY))
    if earlier is not None or "a" not in picture.errors:
        yield [prior]
    for tag_a in rows_of_tag_a:
        yield [prior, tag_a]
        yield [tag_a]  # a camera that was knocked farther than its stability is followed


def _with_tag_a(picture: Exposure, earlier: Exposure | None) -> list[Exposure]:
    """Pictures that may tell where the camera stands: this one, or the one that is remembered."""
    own = [picture] if "a" in picture.errors else []
    return own if earlier is None else [*own, earlier]


def _motion_columns(motion: Motion, picture: Exposure, plant: Plant) -> Array:
    """Left tangents (6, m) in the camera of what the object may do."""
    camera = plant.layout.base_from_camera @ picture.camera_shift
    camera_from_table = camera.inverse() @ plant.layout.base_from_table
    return camera_from_table.adjoint()[:, list(_MOTIONS[motion])]


def _weight(picture: Exposure, name: str) -> Array:
    """Square root (6, 6) of the information of a tag's pose, errors of arm and calibration included."""
    index = {"a": 0, "b": 1}[name]
    tag = picture.tags.get(index)
    centre = np.array([0.0, 0.0, 600.0]) if tag is None else tag.camera_from_tag.translation
    about = Pose(np.eye(3), centre).adjoint()
    covariance = about @ np.diag([RESIDUE_MM**2] * 3 + [RESIDUE_RAD**2] * 3) @ about.T
    if tag is not None:
        covariance = covariance + tag.covariance
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
