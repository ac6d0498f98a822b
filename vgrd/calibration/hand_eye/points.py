"""Hand-eye from points in pictures: lowest reprojection error; optional intrinsics and scale."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vgrd.calibration.hand_eye.features import FeaturePlace, first_places
from vgrd.calibration.hand_eye.fit import HandEyeSample, SampleRows, fit_hand_eye
from vgrd.calibration.hand_eye.pose_pairs import HandEyeResult, result_of
from vgrd.calibration.hand_eye.state import HandEye
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import checked_points, linearize_points, pose_from_points
from vgrd.model import Mount

_MIN_SIGMA_PX = 1e-3  # no detector is better; keeps exact synthetic data solvable


@dataclass(frozen=True, slots=True, eq=False)
class PointSample:
    """One picture of a target with known points: points (n, 3) mm in the target, pixels (n, 2).

    guess: camera_from_target near by, where it is known; it saves time when many fits are made.
    features: pixels (2,) of points fixed to the target, by name; those count whose place is known, or
    that at least two samples show.
    """

    name: str
    base_from_wrist: Pose
    points_in_target: Array
    pixels: Array
    guess: Pose | None = None
    features: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class PointHandEyeProblem:
    """Pictures and how to treat them.

    refine_intrinsics: fx, fy, cx, cy, k1, k2 are estimated too; estimate_scale: so is the size of
    the target, which the robot's motion measures. sigma_px: noise of one pixel coordinate, None
    takes it from the pictures. robot_sigma_mm, robot_sigma_rad: of one flange pose, per axis.
    robust: pictures that fit no common pose are left out and named. start: an earlier result to
    start from (leave-one-out), instead of the certified one. allow_unobservable: as of `HandEyeProblem`.
    places: of features, where known.
    """

    mount: Mount
    camera: CameraModel
    samples: Sequence[PointSample]
    refine_intrinsics: bool = False
    estimate_scale: bool = False
    sigma_px: float | None = None
    robot_sigma_mm: float = 0.1  # as `robot.sigma_mm` of the cell file
    robot_sigma_rad: float = 2e-4  # the same over REACH_MM (500 mm)
    robust: bool = True
    start: HandEyeResult | None = None
    allow_unobservable: int = 0
    places: Mapping[str, FeaturePlace] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class TargetScale:
    """Size of the target as the robot's motion sees it, over the size given; 1 sigma."""

    value: float
    sigma: float


def calibrate_hand_eye_from_points(problem: PointHandEyeProblem) -> HandEyeResult:
    """Maximum likelihood from pixels, with robot noise marginalised.

    Raises InputError (bad sample, named; one pose twice), TooFewObservations, NotObservable (names
    the missing motion) or DidNotConverge.
    """
    guesses, sigma = _guesses(problem)
    sightings = [sample.features for sample in problem.samples]
    places = first_places(sightings, guesses, problem.camera, problem.places)
    samples = [
        HandEyeSample(
            sample.name,
            sample.base_from_wrist,
            pose,
            _PointRows(sample, pose, sigma, list(places)),
        )
        for sample, pose in zip(problem.samples, guesses, strict=True)
    ]
    fit = fit_hand_eye(
        problem.mount,
        samples,
        robot_sigma_mm=problem.robot_sigma_mm,
        robot_sigma_rad=problem.robot_sigma_rad,
        robust=problem.robust,
        start=_start(problem, list(places.values())),
        allow_unobservable=problem.allow_unobservable,
    )
    sigmas = np.sqrt(np.diag(fit.covariance))
    return replace(
        result_of(problem.mount, samples, fit),
        camera=fit.state.camera,
        intrinsics_sigma=sigmas[12:18] if problem.refine_intrinsics else np.zeros(6),
        target_scale=fit.state.scale,
        target_scale_sigma=fit.state.scale * float(sigmas[-1]) if problem.estimate_scale else 0.0,
        features=dict(zip(places, fit.state.points, strict=True)),
    )


def _start(problem: PointHandEyeProblem, places: Sequence[FeaturePlace]) -> HandEye:
    points = np.array([place.point_in_target for place in places]).reshape(-1, 3)
    blank = HandEye(
        camera=problem.camera,
        refines_camera=problem.refine_intrinsics,
        refines_scale=problem.estimate_scale,
        points=points,
        prior_points=points,
        prior_sigma_mm=np.array([place.sigma_mm for place in places]),
    )
    if problem.start is None:
        return blank
    return replace(
        blank,
        X=problem.start.mount_from_camera,
        Y=problem.start.mount_from_target,
        camera=problem.start.camera if problem.refine_intrinsics else problem.camera,
        is_blank=False,
    )


def _guesses(problem: PointHandEyeProblem) -> tuple[list[Pose], float]:
    """First camera_from_target of every sample, and sigma_px."""
    guesses = [sample.guess for sample in problem.samples if sample.guess is not None]
    if problem.sigma_px and len(guesses) == len(problem.samples):
        return guesses, problem.sigma_px
    resections = [_own_pose(sample, problem.camera) for sample in problem.samples]
    sizes = [sample.pixels.size for sample in problem.samples]
    squares = sum(rms**2 * size for (_, rms), size in zip(resections, sizes, strict=True))
    degrees_of_freedom = max(sum(size - 6 for size in sizes), 1)
    sigma = problem.sigma_px or max(float(np.sqrt(squares / degrees_of_freedom)), _MIN_SIGMA_PX)
    return [pose for pose, _ in resections], sigma


def _own_pose(sample: PointSample, camera: CameraModel) -> tuple[Pose, float]:
    try:
        resection = pose_from_points(sample.points_in_target, sample.pixels, camera)
    except InputError as fault:
        raise InputError(f"sample {sample.name!r}: {fault}") from fault
    return resection.camera_from_target, resection.rms_px


class _PointRows(SampleRows):
    """Predicted minus seen pixels over sigma; features: names of the points in the state's order."""

    def __init__(
        self, sample: PointSample, start: Pose, sigma_px: float, features: Sequence[str]
    ) -> None:
        self._points, self._pixels = checked_points(sample.points_in_target, sample.pixels)
        self._sigma = sigma_px
        self._start = start
        names = [name for name in features if name in sample.features]
        self._shown = [features.index(name) for name in names]
        pixels = [sample.features[name] for name in names]
        self._measured_px = np.concatenate([self._pixels, np.reshape(pixels, (-1, 2))])

    def linearize(self, state: HandEye, predicted: Pose) -> tuple[Array, Array, Array]:
        camera = _camera_of(state)
        target_points = self._points * state.scale
        points = np.concatenate([target_points, state.points[self._shown]])
        predicted_px, D = linearize_points(camera, predicted, points)
        E = np.zeros((len(points), 2, state.extra))
        if state.refines_camera:
            E[:, :, :6] = camera.intrinsics_jacobian(predicted @ points)
        J_points = D[:, :, :3] @ predicted.rotation
        for row, k in enumerate(self._shown, len(target_points)):
            first = state.point_columns.start - 12 + 3 * k
            E[row, :, first : first + 3] = J_points[row]
        if state.refines_scale:
            E[: len(target_points), :, -1] = np.einsum(
                "nij,nj->ni", J_points[: len(target_points)], target_points
            )
        r = (predicted_px - self._measured_px).ravel() / self._sigma
        return r, D.reshape(-1, 6) / self._sigma, E.reshape(r.size, -1) / self._sigma

    def own(self, state: HandEye) -> Pose:
        resection = pose_from_points(
            self._points * state.scale, self._pixels, _camera_of(state), self._start
        )
        return resection.camera_from_target

    def rms_px(self, state: HandEye, predicted: Pose) -> float:
        predicted_px = _camera_of(state).project(predicted @ (self._points * state.scale))
        return float(np.sqrt(np.mean((predicted_px - self._pixels) ** 2)))


def _camera_of(state: HandEye) -> CameraModel:
    if state.camera is None:
        raise InputError("points need a camera model")
    return state.camera
