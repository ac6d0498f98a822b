"""Hand-eye calibration: values, and the problem of tag poses with covariances.

One equation serves both mounts: `camera_from_target_i = X^-1 M_i Y` with
eye-to-hand: X = base_from_camera, M = base_from_wrist, Y = wrist_from_target;
eye-in-hand: X = wrist_from_camera, M = wrist_from_base, Y = base_from_target.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vgrd.calibration.hand_eye.fit import Fit, PoseSample, fit_hand_eye
from vgrd.calibration.hand_eye.state import HandEye, flange_motion_of
from vgrd.calibration.levels import Level
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.rotation_relaxation import Certificate
from vgrd.model import Mount

_ODD = 4.0  # times the median misfit: what is told as a reason
_ODD_AT_LEAST = (0.1, 2e-3)  # mm and rad: smaller is nothing to tell an operator


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeProblem:
    """Looks with pose covariances; robot_sigma_*: noise of one flange pose, per axis.

    start: an earlier result to start from, instead of the certified one. allow_unobservable: how many
    translations may stay open: 1 for a 4-axis robot, 3 for one that turns nothing.
    """

    mount: Mount
    samples: Sequence[PoseSample]
    robot_sigma_mm: float = 0.1  # as `robot.sigma_mm` of the cell file
    robot_sigma_rad: float = 2e-4  # the same over REACH_MM (500 mm)
    robust: bool = True
    start: "HandEyeResult | None" = None
    allow_unobservable: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class SampleResidual:
    """How one sample fits: predicted minus measured pose of the target, reprojection rms.

    `reason` says why an unused sample was left out, or what is odd about a used one. deg, mm: of
    the target's pose in the camera; px: rms of the predicted pixels (NaN for pose samples).
    """

    name: str
    used: bool
    reason: str
    deg: float
    mm: float
    px: float = np.nan


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeResult:
    """mount_from_camera: base_from_camera (eye-to-hand) or wrist_from_camera (eye-in-hand).

    mount_from_target: wrist_from_target or base_from_target. covariance: (12, 12) of the left
    tangents of the two, in this order. noise_scale: residuals over what the sigmas promise (the
    covariance is enlarged by it where it is above 1). camera: as refined; target_scale: 1 unless
    it was estimated. certificate: that the start was the best of all rotations; None where an
    earlier result was the start. null_space: (k, 6), orthonormal directions of (t of mount_from_camera, t
    of mount_from_target) that stay open: the target's origin is taken to have no part (0 mm) along
    them, the camera lies accordingly, and the covariance says nothing about them. features: places
    (3,) in the target, mm, of the points that pictures showed beside it. levels: of noise, found in a
    recording; the covariance is then wide enough for 1.96 sigma to be 95 % although they are known by
    `freedom` degrees of freedom only. misfit: minus twice the log-likelihood of the target's poses in the
    pictures, up to a constant. refined: whether the intrinsics were estimated. shares: mm^2
    that each cause adds to the miss of a target's place, by name. as_given: the result with the intrinsics
    as given, where the samples demanded others. looks: (n, 6, 6) noise of one look and one robot pose at each
    sample, of the target's place and turn in the camera, mm and rad.
    """

    mount: Mount
    mount_from_camera: Pose
    mount_from_target: Pose
    covariance: Array
    noise_scale: float
    samples: tuple[SampleResidual, ...]
    camera: CameraModel | None = None
    intrinsics_sigma: Array = field(default_factory=lambda: np.zeros(6))
    target_scale: float = 1.0
    target_scale_sigma: float = 0.0
    certificate: Certificate | None = None
    null_space: Array = field(default_factory=lambda: np.zeros((0, 6)))
    features: Mapping[str, Array] = field(default_factory=dict)
    levels: tuple[Level, ...] = ()
    freedom: float = np.inf
    misfit: float = np.nan
    refined: bool = False
    shares: Mapping[str, float] = field(default_factory=dict)
    as_given: "HandEyeResult | None" = None
    looks: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))

    def predict(self, base_from_wrist: Pose) -> Pose:
        """camera_from_target that this calibration expects at a flange pose."""
        return (
            self.mount_from_camera.inverse()
            @ flange_motion_of(self.mount, base_from_wrist)
            @ self.mount_from_target
        )

    def pose_covariance(self, base_from_wrist: Pose) -> Array:
        """(6, 6): of the target's place and turn in the camera, as expected at a true flange pose; mm, rad."""
        camera_from_mount = self.mount_from_camera.inverse()
        turn = camera_from_mount @ flange_motion_of(self.mount, base_from_wrist)
        J = np.hstack([-camera_from_mount.adjoint(), turn.adjoint()])
        J[:3] -= hat((turn @ self.mount_from_target).translation) @ J[3:]
        return np.asarray(J @ self.covariance @ J.T)


def calibrate_hand_eye(problem: HandEyeProblem) -> HandEyeResult:
    """Maximum likelihood from looks with pose covariances and robot noise.

    Raises TooFewObservations, NotObservable (names the missing motion), InputError (one pose
    twice) or DidNotConverge.
    """
    start = problem.start
    fit = fit_hand_eye(
        problem.mount,
        problem.samples,
        robot_sigma_mm=problem.robot_sigma_mm,
        robot_sigma_rad=problem.robot_sigma_rad,
        robust=problem.robust,
        start=None
        if start is None
        else HandEye(X=start.mount_from_camera, Y=start.mount_from_target),
        allow_unobservable=problem.allow_unobservable,
    )
    return _result(problem.mount, problem.samples, fit)


def _result(mount: Mount, samples: Sequence[PoseSample], fit: Fit) -> HandEyeResult:
    """Dress a fit as a result, residuals of every sample included."""
    predicted = [fit.state.predict(mount, sample.base_from_wrist) for sample in samples]
    misfits = np.array(
        [p.distance(s.camera_from_target) for p, s in zip(predicted, samples, strict=True)]
    )
    typical = np.median(misfits[list(fit.used)], axis=0)
    residuals = []
    for i, sample in enumerate(samples):
        mm, deg = float(misfits[i, 0]), float(np.degrees(misfits[i, 1]))
        reason = fit.reasons[i]
        if fit.used[i] and (misfits[i] > _ODD * typical + _ODD_AT_LEAST).any():
            reason = f"its own pose is {mm:.1f} mm and {deg:.2f} deg off: few or bunched points"
        residuals.append(SampleResidual(sample.name, fit.used[i], reason, deg, mm))
    return HandEyeResult(
        mount=mount,
        mount_from_camera=fit.state.X,
        mount_from_target=fit.state.Y,
        covariance=fit.covariance[:12, :12],
        noise_scale=fit.noise_scale,
        samples=tuple(residuals),
        certificate=fit.state.certificate,
        null_space=fit.null_space,
    )
