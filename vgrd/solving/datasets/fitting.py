"""Hand-eye fits of subsets of a dataset, with the noise levels that the data themselves show."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgrd.calibration.hand_eye import (
    FeaturePlace,
    HandEyeResult,
    PointSample,
    RecordingProblem,
    calibrate_recording,
    demands_refinement,
    points_problem,
    poses_problem,
)
from vgrd.errors import CalibrationError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import pose_from_points
from vgrd.model import Mount

_MOVED_MM = 1.0  # a head that only turns about a point tells no length
_SCALE_SIGMAS = 3.0  # a size that is off by less is chance
_SCALE_MATTERS = 1e-3  # 0.1 mm of a board of 100 mm


@dataclass(frozen=True, slots=True, eq=False)
class TargetScale:
    """Size of the target as the robot's motion sees it, over the size given; 1 sigma."""

    value: float
    sigma: float

    @property
    def excess(self) -> float:
        """By how much the target is larger than given; 0 where that is chance, too little or unknown."""
        deviation = self.value - 1
        is_told = np.isfinite(self.sigma) and abs(deviation) >= max(
            _SCALE_SIGMAS * self.sigma, _SCALE_MATTERS
        )
        return deviation if is_told else 0.0


UNKNOWN_SCALE = TargetScale(np.nan, np.nan)


class Fitter(ABC):
    """Fits chosen samples: levels of noise, samples left out and intrinsics are of those alone."""

    @abstractmethod
    def fit_all(self) -> HandEyeResult:
        """Fit all samples."""

    @abstractmethod
    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """Fit the chosen samples, starting from a result near by."""

    @abstractmethod
    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, from all samples; NaN where they do not tell it."""

    @abstractmethod
    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target of one sample by itself, seen through `camera`."""

    @abstractmethod
    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Predicted minus seen pixels (n, 2); (0, 2) where the sample holds none."""


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodFitter(Fitter):
    """Restricted maximum likelihood. may_refine: intrinsics too where the samples demand it."""

    problem: RecordingProblem
    samples: Sequence[PointSample]
    may_refine: bool

    def fit_all(self) -> HandEyeResult:
        """Fit all samples."""
        return self._fitted(self.problem)

    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """Fit the chosen samples, starting from a result near by."""
        return self._fitted(replace(self.problem.chosen(chosen), start=start))

    def _fitted(self, problem: RecordingProblem) -> HandEyeResult:
        if problem.blank.refines_camera or not self.may_refine:
            return calibrate_recording(problem)
        given = calibrate_recording(replace(problem, start=_as_given(problem)))
        return demands_refinement(problem, given) or given

    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, from all samples; NaN where they do not tell it."""
        if not _moves(self.problem.wrists):
            return UNKNOWN_SCALE
        blank = replace(
            self.problem.blank,
            refines_scale=True,
            refines_camera=start.refined,
            camera=start.camera,
        )
        try:
            result = calibrate_recording(replace(self.problem, blank=blank, start=start))
        except CalibrationError:
            return UNKNOWN_SCALE
        return TargetScale(result.target_scale, result.target_scale_sigma)

    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target with the lowest reprojection error of this sample alone, or as given."""
        if not self.samples or camera is None:
            return self.problem.cameras[index]
        sample = self.samples[index]
        resection = pose_from_points(sample.points_in_target, sample.pixels, camera)
        return resection.camera_from_target

    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Predicted minus seen pixels (n, 2)."""
        if not self.samples or camera is None:
            return np.zeros((0, 2))
        sample = self.samples[index]
        return camera.project(predicted @ sample.points_in_target) - sample.pixels


def _moves(wrists: Sequence[Pose]) -> bool:
    """Whether the flange does more than turn about one point, wherever that is: only ways tell a length."""
    n = len(wrists)
    rows = np.hstack(
        [
            np.concatenate([pose.rotation for pose in wrists]),
            np.tile(-np.eye(3), (n, 1)),
        ]
    )
    places = np.concatenate([pose.translation for pose in wrists])
    # the point that moves least, in the flange and in the base
    point, _, rank, _ = np.linalg.lstsq(rows, -places, rcond=1e-9)
    rest = places + rows @ point
    return bool(np.linalg.norm(rest) > _MOVED_MM * np.sqrt(max(3 * n - rank, 1)))


def _as_given(problem: RecordingProblem) -> HandEyeResult | None:
    """The start of a fit with the intrinsics as given: poses and levels under refined ones are none."""
    if problem.start is None or not problem.start.refined:
        return problem.start
    return problem.start.as_given


def fitter_of_points(
    mount: Mount,
    camera: CameraModel,
    samples: Sequence[PointSample],
    *,
    refine: bool,
    may_refine: bool,
    allow_unobservable: int,
    places: Mapping[str, FeaturePlace],
) -> LikelihoodFitter:
    """Samples with points of the target and their pixels; places: of features, where known."""
    problem = points_problem(
        mount,
        camera,
        samples,
        refine=refine,
        places=places,
        allow_unobservable=allow_unobservable,
    )
    return LikelihoodFitter(problem, samples, may_refine)


def fitter_of_poses(
    mount: Mount, samples: Sequence[tuple[str, Pose, Pose]], *, allow_unobservable: int
) -> LikelihoodFitter:
    """Samples with the pose of the target as somebody else measured it: name, robot, target."""
    problem = poses_problem(mount, samples, allow_unobservable=allow_unobservable)
    return LikelihoodFitter(problem, (), may_refine=False)
