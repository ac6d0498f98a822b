"""Joint estimate: one maximum-likelihood problem over everything that a session tells.

Unknowns: base_from_camera, wrist_from_tag_a, TCP, base_from_object, tag B on the object, the axis of
turning and every turn; optionally tag sizes and intrinsics. What the data leave undetermined is
reported, and refused only by the expected coordinate that depends on it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.special import gammaincinv

from vgrd.calibration.joint.camera_corrections import TAG_A, TAG_B, PriorSigmas, RefinedCorrections
from vgrd.calibration.joint.fit import (
    Optimum,
    fit_at,
    fit_joint,
    information_inverse,
    unknown_in_words,
)
from vgrd.calibration.joint.height import near_tag_plane
from vgrd.calibration.joint.problem import EvidenceKind, JointData, Sighting, Turntable
from vgrd.calibration.joint.robust import JointSample, screen
from vgrd.calibration.joint.rows import predicted_tag_a
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.state import JointState, Layout, guess, layout_of
from vgrd.geometry import Array, log_rotation
from vgrd.geometry.covariance import rms
from vgrd.geometry.least_squares import Report
from vgrd.model import Recording, TagObservation
from vgrd.model.estimate import ArmModel

__all__ = [
    "ArmModel",
    "JointResult",
    "JointSample",
    "PriorSigmas",
    "Sighting",
    "Turntable",
    "calibrate_joint",
    "result_at",
    "start_near_tag_plane",
]

_NOISE_CONFIDENCE = 0.999


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """Estimates (`state`), their uncertainty, and how well the samples agree.

    covariance: (n, n) of a step in `layout`, undetermined directions left out; undetermined:
    (n, z), the step that 500 mm or 1 rad along each of them is. noise_scale: residuals over what the
    sigmas promise; where that is more than chance the covariance was enlarged by its square.
    cost: half the sum of squares. residuals: rms per kind, in mm, deg and sigmas. whitened,
    jacobian: residuals (r,) and derivative (r, n) at the optimum, in sigmas, noise of the arm
    included by `arm_factor` (lower triangle of I + G S G^T) of `J_deviations`: G. data: the samples in
    use; samples: all of them, the bad ones named.
    """

    recording: Recording
    data: JointData
    layout: Layout
    state: JointState
    covariance: Array
    undetermined: Array
    cost: float
    degrees_of_freedom: int
    noise_scale: float
    residuals: Mapping[str, float]
    whitened: Array
    jacobian: Array
    J_deviations: Array
    arm_factor: Array
    report: Report
    samples: tuple[JointSample, ...]

    @property
    def variance_scale(self) -> float:
        """What the covariance was multiplied by."""
        return variance_inflation(2 * self.cost, self.degrees_of_freedom)

    @property
    def corrections(self) -> RefinedCorrections:
        """Refined tag sizes and intrinsics: what corrects a new picture."""
        facts = self.recording.facts
        tags = {facts.tag_a or facts.tag_b: TAG_A, facts.tag_b: TAG_B}
        return RefinedCorrections(
            self.data.corrections, self.state.refined, MappingProxyType(tags)
        )

    def corrected(self, tag: TagObservation) -> TagObservation:
        """A tag in a new picture, as seen with the refined tag sizes and intrinsics."""
        return self.corrections.corrected(tag)

    def unknown_in_words(self) -> str:
        """Which unknowns the data leave undetermined."""
        return unknown_in_words(self.layout, self.undetermined)


def calibrate_joint(
    recording: Recording,
    sightings: Sequence[Sighting] = (),
    *,
    arm: ArmModel | None = None,
    turntable: Turntable | None = None,
    refine: PriorSigmas | None = None,
    robust: bool = True,
) -> JointResult:
    """Most likely values of all unknowns; verifications are held out.

    sightings: holes that the camera saw. arm: None takes `ArmModel.of(facts.robot_sigma_mm)`.
    turntable: how well CAD knows the axis of turning. refine: tag sizes and intrinsics to estimate
    too. robust: samples that the others contradict are left out and named. Raises InputError,
    TooFewObservations, NotObservable or DidNotConverge.
    """
    data = gather(recording, sightings, arm, turntable, refine)
    if len(data.holes.cad):
        seen = start_near_tag_plane(recording, data.holes.cad)
        start = replace(seen, refined=np.zeros(data.corrections.count))
    else:
        start = guess(data)
    optimum = fit_joint(data, layout_of(data), start)
    if not robust:
        return _result(recording, optimum, ())
    return _result(recording, *screen(data, optimum))


def start_near_tag_plane(recording: Recording, points_in_object: Array) -> JointState:
    """First values with points of the object (m, 3) near tag B's plane, where nothing else tells.

    Without that a height that one wrist leaves open may lie behind the camera. Raises
    TooFewObservations where not even a guess is possible.
    """
    data = gather(recording)
    at = result_at(recording, data, guess(data))
    open_too = at.covariance + at.undetermined @ at.undetermined.T
    return near_tag_plane(at.state, at.layout, open_too, points_in_object)


def result_at(recording: Recording, data: JointData, state: JointState) -> JointResult:
    """What the estimate would say if `state` were it: its covariance is the Cramer-Rao bound there.

    data: as `gather` gives it.
    """
    fit = fit_at(data, layout_of(data), state, Report(True, 0, 0.0))
    return _result(recording, fit, ())


def variance_inflation(squares: float, degrees_of_freedom: int) -> float:
    """1, or squares / freedom where that is beyond chance."""
    if degrees_of_freedom <= 0 or squares <= 2 * gammaincinv(
        degrees_of_freedom / 2, _NOISE_CONFIDENCE
    ):
        return 1.0
    return squares / degrees_of_freedom


def _result(
    recording: Recording, optimum: Optimum, samples: tuple[JointSample, ...]
) -> JointResult:
    data, layout = optimum.data, optimum.layout
    covariance, undetermined = information_inverse(optimum.jacobian, layout)
    squares = 2 * optimum.report.cost
    degrees_of_freedom = max(data.measured() - (layout.size - undetermined.shape[1]), 0)
    return JointResult(
        recording=recording,
        data=data,
        layout=layout,
        state=optimum.state,
        covariance=covariance * variance_inflation(squares, degrees_of_freedom),
        undetermined=undetermined,
        cost=optimum.report.cost,
        degrees_of_freedom=degrees_of_freedom,
        noise_scale=float(np.sqrt(squares / degrees_of_freedom)) if degrees_of_freedom else 1.0,
        residuals=_residuals(data, optimum),
        whitened=optimum.whitened,
        jacobian=optimum.jacobian,
        J_deviations=optimum.J_deviations,
        arm_factor=optimum.arm_factor,
        report=optimum.report,
        samples=samples,
    )


def _residuals(data: JointData, optimum: Optimum) -> dict[str, float]:
    state = optimum.state
    out = {
        f"{link.name.lower()}_rms_sigma": rms(optimum.whitened[data.rows_of(link)])
        for link, rows in data.counts.items()
        if rows
    }
    touches = data.touches
    tips = touches.rotations @ state.tcp_in_wrist + touches.translations
    out["touches_rms_mm"] = rms(np.linalg.norm(tips - state.base_from_object @ data.cad, axis=1))
    R, t = predicted_tag_a(state, data)
    seen = data.looks.tags
    turns = log_rotation(R @ np.swapaxes(seen.rotations, 1, 2)).reshape(-1, 3)
    if len(data.holes.cad):
        whitened = optimum.whitened[data.rows_of(EvidenceKind.HOLES)].reshape(-1, 2)
        out["holes_rms_px"] = rms(np.linalg.norm(whitened, axis=1) * data.holes.sigma_px)
    out["hand_eye_rms_mm"] = rms(np.linalg.norm(t - seen.translations, axis=1))
    out["hand_eye_rms_deg"] = float(np.degrees(rms(np.linalg.norm(turns, axis=1))))
    return out
