"""Hand-eye fits of subsets of a dataset, with the noise levels that the data themselves show."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.hand_eye import (
    FeaturePlace,
    HandEyeProblem,
    HandEyeResult,
    PointHandEyeProblem,
    PointSample,
    PoseSample,
    TargetScale,
    calibrate_hand_eye,
    calibrate_hand_eye_from_points,
)
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import pose_from_points
from vgrd.model import Mount

ARM_SIGMA_MM = 0.3  # what the poses of an uncalibrated industrial arm are worth, per axis
ARM_SIGMA_RAD = 3e-4  # the same at 1 m
_NOISE_ROUNDS = 4  # a bound only
_NOISE_MATCHED = 1.1  # residuals over promise: 10 % of a sigma
_MIN_SIGMA_PX = 0.02  # no detector on real pictures is better
_MIN_SIGMA_MM = 0.01  # keeps exact synthetic data solvable
_MIN_SIGMA_RAD = 1e-5  # the same
_START_SIGMA_MM = 1.0  # before the noise is matched; only the ratio counts: alike at 500 mm
_START_SIGMA_RAD = 2e-3  # see above


class Fitter(ABC):
    """Fits chosen samples; `noise` is what `match_noise` found and later fits start from."""

    @abstractmethod
    def match_noise(self) -> HandEyeResult:
        """Fit all samples until the noise level assumed is the one seen in the residuals."""

    @abstractmethod
    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """Fit the chosen samples, as they are, starting from a result near by."""

    @abstractmethod
    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, from all samples."""

    @abstractmethod
    def refined_px(self, start: HandEyeResult) -> float:
        """Reprojection error, px, if the intrinsics were refined; NaN where that cannot be."""

    @abstractmethod
    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target of one sample by itself, seen through `camera`."""

    @abstractmethod
    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Predicted minus seen pixels (n, 2); (0, 2) where the sample holds none."""


class PointFitter(Fitter):
    """Samples with points of the target and their pixels; the rest as of `PointHandEyeProblem`."""

    def __init__(
        self,
        mount: Mount,
        camera: CameraModel,
        samples: Sequence[PointSample],
        *,
        refine: bool,
        allow_unobservable: int,
        places: Mapping[str, FeaturePlace],
    ) -> None:
        guessed = [
            replace(
                sample,
                guess=pose_from_points(
                    sample.points_in_target, sample.pixels, camera
                ).camera_from_target,
            )
            for sample in samples
        ]
        self._problem = PointHandEyeProblem(
            mount,
            camera,
            guessed,
            refine_intrinsics=refine,
            robot_sigma_mm=ARM_SIGMA_MM,
            robot_sigma_rad=ARM_SIGMA_RAD,
            allow_unobservable=allow_unobservable,
            places=places,
        )

    def match_noise(self) -> HandEyeResult:
        """Arm noise is as assumed; what it does not explain counts as noise of the pixels."""
        result = calibrate_hand_eye_from_points(self._problem)
        sigma_px = self._own_sigma_px(result)
        for _ in range(_NOISE_ROUNDS):
            self._problem = replace(self._problem, sigma_px=sigma_px, start=result)
            result = calibrate_hand_eye_from_points(self._problem)
            if result.noise_scale < _NOISE_MATCHED:
                break
            sigma_px *= result.noise_scale
        self._problem = replace(self._problem, start=None)
        return result

    def _own_sigma_px(self, result: HandEyeResult) -> float:
        """Noise of one pixel coordinate when every picture has its own pose."""
        squares = degrees_of_freedom = 0.0
        for index, sample in enumerate(self._problem.samples):
            residuals = self.off_px(index, result.camera, self.own_pose(index, result.camera))
            squares += float((residuals * residuals).sum())
            degrees_of_freedom += sample.pixels.size - 6
        return max(float(np.sqrt(squares / max(degrees_of_freedom, 1))), _MIN_SIGMA_PX)

    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """Fit the chosen samples, as they are, starting from a result near by."""
        samples = [self._problem.samples[i] for i in chosen]
        problem = replace(self._problem, samples=samples, start=start, robust=False)
        return calibrate_hand_eye_from_points(problem)

    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, from all samples."""
        result = calibrate_hand_eye_from_points(
            replace(self._problem, estimate_scale=True, start=start)
        )
        return TargetScale(result.target_scale, result.target_scale_sigma)

    def refined_px(self, start: HandEyeResult) -> float:
        """Reprojection error, px, if the intrinsics were refined; NaN where that cannot be."""
        problem = replace(self._problem, refine_intrinsics=True, start=start, robust=False)
        try:
            result = calibrate_hand_eye_from_points(problem)
        except CalibrationError:
            return float("nan")
        return reprojection_px(result)

    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target with the lowest reprojection error of this sample alone."""
        sample = self._problem.samples[index]
        resection = pose_from_points(
            sample.points_in_target, sample.pixels, camera or self._problem.camera
        )
        return resection.camera_from_target

    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Predicted minus seen pixels (n, 2)."""
        sample = self._problem.samples[index]
        projected = (camera or self._problem.camera).project(predicted @ sample.points_in_target)
        return projected - sample.pixels


class PoseFitter(Fitter):
    """Samples with the pose of the target as somebody else measured it; name, robot, target.

    may_be_free: as of `HandEyeProblem`.
    """

    def __init__(
        self, mount: Mount, samples: Sequence[tuple[str, Pose, Pose]], *, allow_unobservable: int
    ) -> None:
        self._problem = HandEyeProblem(
            mount,
            _with_noise(
                [PoseSample(*sample, np.eye(6)) for sample in samples],
                _START_SIGMA_MM,
                _START_SIGMA_RAD,
            ),
            robot_sigma_mm=ARM_SIGMA_MM,
            robot_sigma_rad=ARM_SIGMA_RAD,
            allow_unobservable=allow_unobservable,
        )

    def match_noise(self) -> HandEyeResult:
        """Noise of the measured poses, in mm and rad, as their misfit shows it."""
        for _ in range(_NOISE_ROUNDS):
            result = calibrate_hand_eye(self._problem)
            self._problem = replace(self._with_noise_of(result), start=result)
        result = calibrate_hand_eye(self._problem)
        self._problem = replace(self._problem, start=None)
        return result

    def _with_noise_of(self, result: HandEyeResult) -> HandEyeProblem:
        good = [residual for residual in result.samples if residual.used]
        share = np.sqrt(2 * len(good) / (2 * len(good) - 4)) / np.sqrt(3)
        mm = share * np.sqrt(np.mean([residual.mm**2 for residual in good]))
        rad = share * np.sqrt(np.mean([np.radians(residual.deg) ** 2 for residual in good]))
        return replace(self._problem, samples=_with_noise(self._problem.samples, mm, rad))

    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """Fit the chosen samples, as they are, starting from a result near by."""
        samples = [self._problem.samples[i] for i in chosen]
        problem = replace(self._problem, samples=samples, start=start, robust=False)
        return calibrate_hand_eye(problem)

    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, from all samples."""
        result = calibrate_hand_eye(replace(self._problem, estimate_scale=True, start=start))
        return TargetScale(result.target_scale, result.target_scale_sigma)

    def refined_px(self, start: HandEyeResult) -> float:
        """NaN: poses hold no pixels."""
        del start
        return float("nan")

    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target as it was given."""
        del camera
        return self._problem.samples[index].camera_from_target

    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Nothing: such samples hold no pixels."""
        del index, camera, predicted
        return np.zeros((0, 2))


def reprojection_px(result: HandEyeResult) -> float:
    """Rms distance of predicted and seen points over the samples used; NaN where none has pixels.

    `SampleResidual.px` counts one coordinate, a distance has two.
    """
    return float(np.sqrt(2 * np.mean([s.px**2 for s in result.samples if s.used])))


def _with_noise(samples: Sequence[PoseSample], mm: float, rad: float) -> list[PoseSample]:
    """Independent noise of the target's position and orientation, as left tangent covariances."""
    variances = np.square([max(mm, _MIN_SIGMA_MM)] * 3 + [max(rad, _MIN_SIGMA_RAD)] * 3)
    noisy_samples = []
    for sample in samples:
        A = np.eye(6)
        A[:3, 3:] = hat(sample.camera_from_target.translation)
        noisy_samples.append(replace(sample, covariance=A * variances @ A.T))
    return noisy_samples
