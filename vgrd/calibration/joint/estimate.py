"""Joint estimate: one maximum-likelihood problem over everything that a session tells.

Unknowns: base_from_camera, wrist_from_tag_a, TCP, base_from_object, the targets without CAD, tag B on the
object, the axis of turning and every turn; optionally tag sizes and intrinsics. What the data leave undetermined is
reported, and refused only by the expected coordinate that depends on it.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np

from vgrd.calibration.joint.camera_corrections import CameraCorrections, PriorSigmas
from vgrd.calibration.joint.fit import JointFit, fit_at, fit_joint
from vgrd.calibration.joint.knocks import Moves, Trial, follow, jumps, pictures_of
from vgrd.calibration.joint.noise.lens import PRIOR_SHARE, with_lens
from vgrd.calibration.joint.noise.leveling import at_found_levels
from vgrd.calibration.joint.noise.priors import at_sigmas
from vgrd.calibration.joint.problem import EvidenceKind, HolePixel, JointData, Turntable
from vgrd.calibration.joint.robust import screen
from vgrd.calibration.joint.rows import seen_tag_a, touched_places
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import JointState, StepLayout, layout_of, left_jacobian
from vgrd.errors import CalibrationError, DidNotConverge
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.covariance import rms
from vgrd.geometry.least_squares import Convergence
from vgrd.model import ArmModel, Recording, Stability

HEIGHT_SIGMA_MM = 3.0  # targets and tag lie on one plate, give or take its thickness


def calibrate_joint(
    recording: Recording,
    sightings: Sequence[HolePixel] = (),
    *,
    arm: ArmModel | None = None,
    turntable: Turntable | None = None,
    refine: PriorSigmas | None = None,
    robust: bool = True,
    find_noise: bool = True,
) -> JointFit:
    """Most likely values of all unknowns; verifications are held out.

    sightings: holes that the camera saw. arm: None takes `facts.arm`.
    turntable: how well CAD knows the axis of turning. refine: tag sizes and intrinsics to estimate
    too; None: the tag sizes, as far as `facts` have them inexact, and the focal length where the samples are
    at odds without it. robust: samples that the others contradict
    are left out and named, and a fixed camera that was knocked meanwhile is followed. find_noise: sigmas are
    priors of levels that the samples tell; else they count as they are stated. Raises InputError,
    TooFewObservations, NotObservable or DidNotConverge.
    """

    def estimate(sigmas: PriorSigmas) -> JointFit:
        return _estimate(recording, sightings, arm, turntable, sigmas, robust, find_noise)

    if refine is not None:
        return estimate(refine)
    print_sigmas = PriorSigmas.of_print(recording.facts)
    fit = estimate(print_sigmas)
    if not (robust and find_noise):
        return fit
    focal_px = PRIOR_SHARE * float(np.asarray(recording.facts.camera_matrix)[0, 0])
    fit, told = with_lens(fit, lambda: estimate(replace(print_sigmas, focal_px=focal_px)))
    return fit if told is None else replace(fit, freed=(*fit.freed, told))


def _estimate(
    recording: Recording,
    sightings: Sequence[HolePixel],
    arm: ArmModel | None,
    turntable: Turntable | None,
    print_sigmas: PriorSigmas,
    robust: bool,
    find_noise: bool,
) -> JointFit:
    """As `calibrate_joint`, with what is to be refined."""

    @cache
    def gathered(
        moves_s: Moves,
    ) -> JointData:
        return gather(
            recording, sightings, arm, turntable, print_sigmas.without_stretches, moves_s
        )

    def solve(moves_s: Moves) -> Trial:
        data = gathered(moves_s)
        optimum = fit_joint(data, layout_of(data), _start(data))
        return Trial(moves_s, optimum, screen(data, optimum) if robust else optimum)

    def finished(data: JointData, trial: Trial) -> JointFit:
        return at_found_levels(data, trial, robust=robust) if find_noise else trial.screened

    trial = _followed(recording, gathered, solve, robust=robust)
    data = gathered(trial.moves_s)
    corrections = CameraCorrections.of(recording.facts, print_sigmas)
    if corrections.count > data.corrections.count:
        # A stretch takes up what a camera that moved, or a bad sample, does: it is tried when these are known.
        stretched = replace(data, corrections=corrections)
        with suppress(DidNotConverge):
            return finished(stretched, _stretched(trial, stretched, robust, is_rough=find_noise))
    return finished(data, trial)


def _stretched(trial: Trial, data: JointData, robust: bool, *, is_rough: bool) -> Trial:
    """The same with tags that may be wider than high; is_rough: as of `fit_joint`."""
    start = at_sigmas(trial.optimum.state, trial.optimum.data, data)
    optimum = fit_joint(data, layout_of(data), start, is_near=True, is_rough=is_rough)
    return Trial(trial.moves_s, optimum, screen(data, optimum) if robust else optimum)


def _followed(
    recording: Recording,
    gathered: Callable[[Moves], JointData],
    solve: Callable[[Moves], Trial],
    *,
    robust: bool,
) -> Trial:
    """With the knocks of a fixed camera, where they are looked for."""
    if not robust or recording.facts.camera_stability is Stability.MOVABLE:
        return solve(())
    try:
        trial = solve(())
    except DidNotConverge:
        if not (moves_s := _jumps(gathered)):
            raise
        trial = solve(moves_s)
    return follow(trial, solve)


def _jumps(gathered: Callable[[Moves], JointData]) -> Moves:
    """When the camera moved so far that nothing fits without it: by every picture for itself."""
    every = gathered(tuple(pictures_of(gathered(()))[1:]))
    try:
        return jumps(every, guess(every).taught_from_camera)
    except CalibrationError:
        return ()


def _start(data: JointData) -> JointState:
    if not len(data.holes.cad):
        return guess(data)
    guessed = start_near_tag_plane(data.recording, data.holes.cad, data.places.first_s)
    return replace(guessed, refined=np.zeros(data.corrections.count))


def start_near_tag_plane(
    recording: Recording, points_in_object: Array, moves_s: Moves = ()
) -> JointState:
    """First values with points of the object (m, 3) near tag B's plane, where nothing else tells.

    Without that a height that one wrist leaves open may lie behind the camera. Raises
    TooFewObservations where not even a guess is possible.
    """
    data = gather(recording, moves_s=moves_s)
    fit = fit_as_if(data, guess(data))
    open_too = fit.covariance + fit.undetermined @ fit.undetermined.T
    return near_tag_plane(fit.state, fit.layout, open_too, points_in_object)


def fit_as_if(data: JointData, state: JointState) -> JointFit:
    """What the estimate would say if `state` were it: its covariance is the Cramer-Rao bound there.

    data: as `gather` gives it.
    """
    return fit_at(data, layout_of(data), state, Convergence(True, 0, 0.0))


def residuals_of(fit: JointFit) -> dict[str, float]:
    """Rms per kind of evidence, in mm, deg, px and sigmas."""
    state, data = fit.state, fit.data
    residuals = {
        f"{link.name.lower()}_rms_sigma": rms(fit.whitened[data.rows_of(link)])
        for link, rows in data.counts.items()
        if rows
    }
    touches = data.touches
    tips = touches.rotations @ state.tcp_in_wrist + touches.translations
    residuals["touches_rms_mm"] = rms(np.linalg.norm(tips - touched_places(state, data), axis=1))
    tags = data.looks.tags
    R, t = seen_tag_a(state, data)
    turns = log_rotation(R @ np.swapaxes(tags.rotations, 1, 2)).reshape(-1, 3)
    if len(data.holes.cad):
        whitened = fit.whitened[data.rows_of(EvidenceKind.HOLES)].reshape(-1, 2)
        residuals["holes_rms_px"] = rms(np.linalg.norm(whitened, axis=1) * data.holes.sigma_px)
    residuals["hand_eye_rms_mm"] = rms(np.linalg.norm(t - tags.translations, axis=1))
    residuals["hand_eye_rms_deg"] = float(np.degrees(rms(np.linalg.norm(turns, axis=1))))
    return residuals


def near_tag_plane(
    state: JointState, layout: StepLayout, covariance: Array, points_in_object: Array
) -> JointState:
    """The state moved, within its covariance (n, n), so that points (m, 3) lie in tag B's plane.

    The plane counts as known to HEIGHT_SIGMA_MM: next to nothing beside touches that tell the height.
    """
    in_base = state.base_from_object @ points_in_object
    in_camera = state.base_from_camera.inverse() @ in_base
    tag_b_from_camera = state.camera_from_tag_b.inverse()
    down = tag_b_from_camera.rotation[2]
    H = np.zeros((len(in_base), layout.size))
    H[:, StepLayout.OBJECT] = (down @ state.base_from_camera.rotation.T) @ left_jacobian(in_base)
    H[:, StepLayout.CAMERA] = -H[:, StepLayout.OBJECT]
    H[:, StepLayout.TAG_B] = -down @ left_jacobian(in_camera)
    spread = H @ covariance @ H.T + HEIGHT_SIGMA_MM**2 * np.eye(len(H))
    heights = (tag_b_from_camera @ in_camera)[:, 2]
    return state.retract(-covariance @ H.T @ np.linalg.solve(spread, heights), layout)
