"""One more picture as evidence: tag B on the object, tag A on the flange, and where the camera may stand.

Both tags in one picture give the object in the robot's frame wherever the camera stands (Eq. 5, 6). The
camera's displacement since teaching, D = taught_from_camera, is an unknown of the picture: tag A with the
flange pose of the same instant measures it, its stability is a prior of it. The first guess of D is the
paper's chain, so that a camera that was moved far is linearised where it stands.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vgrd.calibration.joint.camera_corrections import TAG_A, TAG_B, RefinedCorrections
from vgrd.calibration.joint.problem import Tags
from vgrd.calibration.joint.rows import ObjectMotions, moved_tag, object_motions, tag_residuals
from vgrd.calibration.joint.state import StepLayout, table_motion_of
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.covariance import sqrt_information
from vgrd.judging.thresholds import CAMERA_STANDS, CONTRADICTS, FITS_MODEL
from vgrd.model import CameraPlace, FlangeTag, Motion, TagObservation


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Poses of the estimate that pictures are compared with.

    covariance (n, n): of a step in `layout`, left perturbations. refined: tag sizes and intrinsics.
    """

    base_from_camera: Pose
    wrist_from_tag_a: Pose
    camera_from_tag_b: Pose
    camera_from_axis: Pose
    layout: StepLayout
    covariance: Array
    refined: RefinedCorrections


@dataclass(frozen=True, slots=True, eq=False)
class ArmPrior:
    """Deviations (w,) of the arm (mm, rad) at the stands that an answer depends on.

    mean (w,), J_unknowns (w, n) by the estimate, covariance (w, w) of what is left. The stand of the
    picture comes first where tag A is used.
    """

    mean: Array
    J_unknowns: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Residuals (r,) of a picture, whitened, and what they depend on.

    J_known (r, n + w): unknowns and deviations; J_camera (r, 6): the camera's displacement, left;
    J_motion (r, k): the object's motion. J_tag_a (6 or 0, 6), J_tag_b (6, 6): of the rows of each tag
    by a slip in its own frame.
    """

    residual: Array
    J_known: Array
    J_camera: Array
    J_motion: Array
    J_tag_a: Array
    J_tag_b: Array

    def free(self, *, is_exact: bool) -> Array:
        """Derivative (r, f) by what has no prior of its own: the motion, and where the camera stands."""
        return self.J_motion if is_exact else np.hstack([self.J_motion, self.J_camera])

    def covariance(self, links: Links, arm: ArmPrior) -> Array:
        """(r, r): noise, and what is known only so well."""
        by_known = self.J_known @ _covariance_of_known(links, arm) @ self.J_known.T
        return np.asarray(np.eye(len(self.residual)) + by_known)


@dataclass(frozen=True, slots=True, eq=False)
class PictureFit:
    """What a picture tells of the unknowns (n), the arm's deviations (w) and the object's motion (k).

    residual (r,), whitened, at the first guess; J_known (r, n + w): by unknowns and deviations; gain
    (n + w + k, r): minus the correction of all per residual. sqrt_information (6, 6): whitens tag B's
    left tangent in the picture, the first six rows. motion: of the object, first guess.
    taught_from_camera: how the camera has moved, as estimated. misfit: squares that no motion
    explains, of so many degrees of freedom.
    """

    motion: ObjectMotions
    residual: Array
    J_known: Array
    gain: Array
    sqrt_information: Array
    taught_from_camera: Pose
    misfit: float
    freedom: int

    @property
    def stands(self) -> bool:
        """Whether an answer may rest on it; the first pictures are held to `fits`, in their order."""
        return self.freedom == 0 or self.misfit <= chi2_quantile(CONTRADICTS, self.freedom)

    @property
    def fits(self) -> bool:
        """Whether the object moved as it can, with the camera where it may stand."""
        return self.freedom == 0 or self.misfit <= chi2_quantile(FITS_MODEL, self.freedom)


@dataclass(frozen=True, slots=True, eq=False)
class TagARows:
    """Residual (6,) of tag A, whitened; J_known (6, n + 6): by unknowns and the arm's deviation there.

    J_camera (6, 6): by the camera's displacement, J_slip (6, 6): by a slip of the tag in its own frame.
    """

    residual: Array
    J_known: Array
    J_camera: Array
    J_slip: Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraGuess:
    """Where the camera stands at first: taught_from_camera, and the place with what of it is believed.

    tag_a: None where it is not used. square: how far tag A puts the camera from where its stability may
    have it, in squared sigmas of six numbers; 0 where that is not compared.
    """

    taught_from_camera: Pose
    place: CameraPlace
    tag_a: TagARows | None = None
    square: float = 0.0

    @property
    def knocked(self) -> bool:
        """Whether the camera moved farther than its stability explains."""
        return self.square > chi2_quantile(FITS_MODEL, 6)


@dataclass(frozen=True, eq=False)
class PictureModel:
    """One picture at its first guess, about which everything is linear.

    guess: where the camera stands; arm: its deviations at the stands that count; tags: tag B as the
    taught camera would see it; motions: of the object.
    """

    links: Links
    guess: CameraGuess
    arm: ArmPrior
    tags: Tags
    motions: ObjectMotions

    @cached_property
    def rows(self) -> Rows:
        """Residuals of tag B, of tag A where it is used, and of the stability of a camera that has one."""
        return _rows_of(self)

    @property
    def covariance(self) -> Array:
        """(r, r) of the residuals."""
        return self.rows.covariance(self.links, self.arm)

    @property
    def free(self) -> Array:
        """Derivative (r, f) by what has no prior of its own."""
        return self.rows.free(is_exact=self.guess.place.is_exact)

    def with_place(self, place: CameraPlace) -> "PictureModel":
        """With the camera's stability as it is configured, whether or not tag A contradicts it."""
        if place is self.guess.place:
            return self
        guess = CameraGuess(self.guess.taught_from_camera, place, self.guess.tag_a)
        return replace(self, guess=guess)


def guess_camera(links: Links, place: CameraPlace, arm: ArmPrior) -> CameraGuess:
    """By the paper's chain where tag A is seen, else where it stood while teaching.

    A stability that contradicts the chain beyond chance is not believed: the camera was moved. Raises
    TagNotSeen for a camera that may stand anywhere while nothing tells where.
    """
    seen = place.flange_tag
    if seen is None:
        place.check_known()
        return CameraGuess(Pose.identity(), place)
    D = Pose.identity()
    if not place.is_exact:
        chain = links.base_from_camera.inverse() @ seen.base_from_wrist @ links.wrist_from_tag_a
        D = chain @ seen.tag.camera_from_tag.inverse()
    rows = _rows_of_tag_a(links, D, seen, arm)
    if place.is_exact or place.is_free:
        return CameraGuess(D, place, rows)
    square = _displacement_square(links, place, D, rows, arm)
    if square > chi2_quantile(CAMERA_STANDS, 6):
        place = replace(place, stability=np.full(6, np.inf))
    return CameraGuess(D, place, rows, square)


def _displacement_square(
    links: Links, place: CameraPlace, taught_from_camera: Pose, rows: TagARows, arm: ArmPrior
) -> float:
    """How far the chain puts the camera from where it was, in squared sigmas of chain and stability."""
    by_chain = np.linalg.inv(rows.J_camera)
    spread = np.eye(6) + rows.J_known @ _covariance_of_known(links, arm) @ rows.J_known.T
    spread = by_chain @ spread @ by_chain.T + np.diag(place.stability**2)
    way = taught_from_camera.log() - by_chain @ rows.residual
    return float(way @ np.linalg.solve(spread, way))


def first_motion(
    links: Links, guess: CameraGuess, tag_b: TagObservation, motion: Motion | None
) -> tuple[Tags, ObjectMotions]:
    """Tag B as the taught camera would see it, and how the object moved; motion None: anyhow."""
    tag, G = guess.taught_from_camera @ tag_b.camera_from_tag, guess.taught_from_camera.adjoint()
    moved = tag @ links.camera_from_tag_b.inverse()
    if motion is None:
        J_axis = np.zeros((1, 6, len(links.layout.axis)))
        motions = ObjectMotions(
            moved.rotation[None], moved.translation[None], J_axis, np.eye(6)[None]
        )
    else:
        on_table = table_motion_of(links.camera_from_axis, moved, motion)[None]
        motions = object_motions(links.camera_from_axis, on_table, links.layout)
    moved = Pose(motions.rotations[0], motions.translations[0])
    predicted = guess.taught_from_camera.inverse() @ moved @ links.camera_from_tag_b
    by_refined = G @ links.refined.tangent(predicted, TAG_B)
    return _as_tags(tag, G @ tag_b.covariance @ G.T, by_refined), motions


def weigh(model: PictureModel) -> PictureFit:
    """Most likely unknowns, deviations and motion (Eq. 5 and 6 with the camera's displacement D).

    Motion and D are left free but for the stability of the camera, the others have their priors.
    """
    rows, guess, tags = model.rows, model.guess, model.tags
    r, k = rows.residual, rows.J_motion.shape[1]
    prior = _covariance_of_known(model.links, model.arm)
    S_inv = np.linalg.inv(model.covariance)
    N = model.free
    free_gain = np.linalg.solve(N.T @ S_inv @ N, N.T @ S_inv)
    unexplained = np.eye(len(r)) - N @ free_gain
    misfit = float((unexplained @ r) @ S_inv @ (unexplained @ r))
    step = Pose.exp(-free_gain[k:] @ r) if len(free_gain) > k else Pose.identity()
    return PictureFit(
        motion=model.motions,
        residual=r,
        J_known=rows.J_known,
        gain=np.vstack([prior @ rows.J_known.T @ S_inv @ unexplained, free_gain[:k]]),
        sqrt_information=tags.sqrt_informations[0] @ guess.taught_from_camera.adjoint(),
        taught_from_camera=step @ guess.taught_from_camera,
        misfit=misfit,
        freedom=len(r) - N.shape[1],
    )


def _as_tags(camera_from_tag: Pose, covariance: Array, J_refined: Array) -> Tags:
    return Tags(
        camera_from_tag.rotation[None],
        camera_from_tag.translation[None],
        sqrt_information(covariance)[None],
        J_refined[None],
    )


def _covariance_of_known(links: Links, arm: ArmPrior) -> Array:
    """Prior (n + w, n + w) of unknowns and deviations."""
    n = len(links.covariance)
    out = np.zeros((n + len(arm.mean),) * 2)
    out[:n, :n], out[n:, n:] = links.covariance, arm.covariance
    return out


def _rows_of(model: PictureModel) -> Rows:
    links, guess, arm, motions = model.links, model.guess, model.arm, model.motions
    n, w, k = links.layout.size, len(arm.mean), motions.J_motion.shape[2]
    r_b, J_b, J_motion = (
        part[0] for part in moved_tag(links.camera_from_tag_b, model.tags, motions, links.layout)
    )
    r_b = r_b + J_b[:, links.layout.refined_columns] @ links.refined.stretches
    motion_of_object = Pose(motions.rotations[0], motions.translations[0])
    expected = motion_of_object @ links.camera_from_tag_b
    by_expected = J_b[:, links.layout.TAG_B] @ motion_of_object.inverse().adjoint()
    residuals, known = [r_b], [np.hstack([J_b, np.zeros((6, w))])]
    # The displacement moves what was measured.
    camera = [-by_expected @ (expected @ model.tags.poses()[0].inverse()).adjoint()]
    J_tag_a = np.zeros((0, 6))
    if (tag_a := guess.tag_a) is not None:
        residuals.append(tag_a.residual)
        known.append(np.hstack([tag_a.J_known, np.zeros((6, w - 6))]))
        camera.append(tag_a.J_camera)
        J_tag_a = tag_a.J_slip
    if not (guess.place.is_exact or guess.place.is_free):
        tangent = guess.taught_from_camera.log()
        residuals.append(tangent / guess.place.stability)
        known.append(np.zeros((6, n + w)))
        camera.append(np.linalg.inv(Pose.left_jacobian(tangent)) / guess.place.stability[:, None])
    motion = [J_motion] + [np.zeros((6, k))] * (len(residuals) - 1)
    return Rows(
        np.concatenate(residuals),
        np.vstack(known),
        np.vstack(camera),
        np.vstack(motion),
        J_tag_a,
        by_expected @ expected.adjoint(),
    )


def _rows_of_tag_a(
    links: Links, taught_from_camera: Pose, seen: FlangeTag, arm: ArmPrior
) -> TagARows:
    """arm: its deviation in the picture alone."""
    n, W = links.layout.size, seen.base_from_wrist
    camera_from_taught = taught_from_camera.inverse()
    camera_from_base = camera_from_taught @ links.base_from_camera.inverse()
    expected = camera_from_base @ W @ links.wrist_from_tag_a
    by_refined = links.refined.tangent(expected, TAG_A)
    tags = _as_tags(seen.tag.camera_from_tag, seen.tag.covariance, by_refined)
    r, D, E = (
        part[0]
        for part in tag_residuals(expected.rotation[None], expected.translation[None], tags)
    )
    by_base = D @ camera_from_base.adjoint()
    J = np.zeros((6, n + 6))
    J[:, links.layout.CAMERA] = -by_base
    J[:, links.layout.TAG_A] = by_base @ W.adjoint()
    J[:, links.layout.refined_columns] = E
    J[:, n : n + 6] = by_base
    J[:, n + 3 : n + 6] += by_base[:, :3] @ hat(W.translation)  # it turns about the flange
    by_arm = J[:, n:]
    J[:, :n] += by_arm @ arm.J_unknowns
    r = r + by_arm @ arm.mean + E @ links.refined.stretches
    return TagARows(r, J, -D @ camera_from_taught.adjoint(), D @ expected.adjoint())
