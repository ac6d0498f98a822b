"""What one picture cannot tell: slips of a link that show nowhere, and those that put the answer off.

To first order, about a picture that fits: a slip shows where it changes what motion and camera do not
explain (the rows of the served update), and it harms where it moves the answer off the target.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.blind_spots.courses import UNITS, Slips, orthonormal, slips_of
from vgrd.calibration.joint import JointSolution
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import sqrt_information
from vgrd.model import CameraPlace, CellFacts, Link, Policy, TagObservation

_NO_TRACE = 1e-5  # sigmas by 1 mm: rounding gives 1e-9, a camera that may stand a metre off 1e-3
_NO_ERROR = 0.05  # of a slip: a picture that misfits by 0.5 mm gives 0.002, what harms 0.3 or more
_SAME = 1e-6  # of a unit vector: rounding is 1e-12
_SHOWS = 5.0  # sigmas: FITS_MODEL of the five numbers of a turntable's picture ends at 5.1


@dataclass(frozen=True, slots=True, eq=False)
class BlindSpot:
    """What one picture cannot tell of one link.

    untold: (6, k) orthonormal, all slips (mm, rad) that leave no trace. harmful: those of them that put
    the answer off, harmless: those with which it is right. harmful_as_knock, harmless_as_knock: slips
    that leave no trace but one, the camera seems knocked; small ones are not told. shows_from_mm: the
    size from which on a mere shift shows in every direction in which one shows; None where none does.
    """

    untold: Array
    harmful: Slips
    harmless: Slips
    harmful_as_knock: Slips
    harmless_as_knock: Slips
    shows_from_mm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class _Effects:
    """Of a slip (mm, rad) of each link: what shows (f, 6), in sigmas, and the answers' error (6 t, 6)."""

    traces: Mapping[Link, Array]
    errors: Mapping[Link, Array]


def blind_spots(
    solution: JointSolution, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace
) -> Mapping[Link, BlindSpot]:
    """What a picture with tag B, and with tag A where `camera` has it, cannot tell of each link.

    A slip is in the link's own frame: base_from_camera, wrist_from_tag_a or object_from_tag_b, each
    times exp(slip); of the object: in the frame of its tag B, which moves with it.
    Raises TagNotSeen for a camera that may stand anywhere while tag A is hidden.
    """
    effects = knocked = _effects(solution, facts, tag_b, camera)
    if camera.flange_tag is not None and not (camera.is_exact or camera.is_free):
        anywhere = replace(camera, stability=np.full(6, np.inf))
        knocked = _effects(solution, facts, tag_b, anywhere)
    frames = _frames(solution, facts, tag_b, camera)
    spots = {}
    for link in Link:
        untold, frame = _null_space(effects.traces[link]), frames[link]
        as_knock = _beyond(_null_space(knocked.traces[link]), untold)
        harmful, harmless = _parted(untold, effects.errors[link])
        harmful_as_knock, harmless_as_knock = _parted(as_knock, knocked.errors[link])
        spots[link] = BlindSpot(
            untold=untold,
            harmful=slips_of(harmful, frame),
            harmless=slips_of(harmless, frame),
            harmful_as_knock=slips_of(harmful_as_knock, frame),
            harmless_as_knock=slips_of(harmless_as_knock, frame),
            shows_from_mm=_shows_from(effects.traces[link]),
        )
    return spots


def _effects(
    solution: JointSolution, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace
) -> _Effects:
    targets = facts.object.targets
    known = [name for name in targets if solution.layout.knows(targets[name])]
    errors = [_errors(solution, facts, name, tag_b, camera) for name in known]
    return _Effects(
        solution.slip_traces(facts, tag_b, camera),
        {link: np.vstack([error[link] for error in errors]) for link in Link},
    )


def _errors(
    solution: JointSolution,
    facts: CellFacts,
    name: str,
    tag_b: TagObservation,
    camera: CameraPlace,
) -> Mapping[Link, Array]:
    """How a slip puts the flange off a target, (6, 6): mm and rad, by (mm, rad).

    With a wrist that follows, so that an object that turns counts.
    """
    target = facts.object.targets[name]
    one = solution.predict(facts, target, tag_b, Policy.FOLLOW, np.eye(3), camera, refuse=False)
    by_tag = np.vstack([one.J_picture, one.J_turn_picture])
    by_b = by_tag @ tag_b.camera_from_tag.adjoint()
    by_chain, by_a = np.zeros((6, 6)), np.zeros((6, 6))
    if (seen := camera.flange_tag) is not None:
        whiten = sqrt_information(seen.tag.covariance)
        by_chain = np.vstack([one.J_camera[:, :6], one.J_turn_camera[:, :6]]) @ whiten
        by_a = by_chain @ seen.tag.camera_from_tag.adjoint()
    camera_in_base = solution.base_from_camera @ one.taught_from_camera
    in_base = (camera_in_base @ tag_b.camera_from_tag).adjoint()
    moved = in_base.copy()
    moved[:3] -= hat(one.base_from_wrist.translation) @ in_base[3:]
    return {
        Link.CAMERA: -by_tag - by_chain,
        Link.TAG_A: by_a,
        Link.TAG_B: by_b,
        Link.OBJECT: by_b - moved,
    }


def _frames(
    solution: JointSolution, facts: CellFacts, tag_b: TagObservation, camera: CameraPlace
) -> Mapping[Link, Pose]:
    """axis_from_link: the frame of each link as seen from the axis of turning."""
    stands = solution.examine(facts, tag_b, camera).taught_from_camera or Pose.identity()
    axis_from_camera = solution.camera_from_axis.inverse() @ stands
    in_tag_b, seen = axis_from_camera @ tag_b.camera_from_tag, camera.flange_tag
    return {
        Link.CAMERA: axis_from_camera,
        Link.TAG_A: axis_from_camera @ seen.tag.camera_from_tag if seen else Pose.identity(),
        Link.TAG_B: in_tag_b,
        Link.OBJECT: in_tag_b,
    }


def _parted(slips: Array, error: Array) -> tuple[Array, Array]:
    """Slips (6, k) that move the answers, by an error (6 t, 6), and those that do not."""
    slips = UNITS[:, None] * orthonormal(slips / UNITS[:, None])
    units = np.tile(UNITS, len(error) // 6)[:, None]
    sizes, Vt = np.linalg.svd(error @ slips / units, full_matrices=True)[1:]
    count = int(np.sum(sizes > _NO_ERROR))
    return slips @ Vt[:count].T, slips @ Vt[count:].T


def _null_space(trace: Array) -> Array:
    """Orthonormal (6, k): slips that show nowhere in a trace (f, 6)."""
    sizes, Vt = np.linalg.svd(trace * UNITS, full_matrices=True)[1:]
    return orthonormal(UNITS[:, None] * Vt[int(np.sum(sizes > _NO_TRACE)) :].T)


def _beyond(slips: Array, others: Array) -> Array:
    """Orthonormal (6, k): what of the slips (6, n) lies across the others (6, m), both orthonormal."""
    U, sizes, _ = np.linalg.svd(slips - others @ (others.T @ slips), full_matrices=False)
    return np.asarray(U[:, sizes > _SAME])


def _shows_from(trace: Array) -> float | None:
    sizes = np.linalg.svd(trace[:, :3], compute_uv=False)
    shown = sizes[sizes > _NO_TRACE]
    return float(_SHOWS / shown.min()) if len(shown) else None
