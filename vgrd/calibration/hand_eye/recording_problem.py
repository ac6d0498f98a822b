"""A recording as a problem of hand-eye: flange poses, each with pixels of the target or with its pose."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vgrd.calibration.hand_eye.features import FeaturePlace, first_places
from vgrd.calibration.hand_eye.pose_pairs import HandEyeResult
from vgrd.calibration.hand_eye.rows import Evidence, PointEvidence, PoseEvidence
from vgrd.calibration.hand_eye.state import HandEye
from vgrd.calibration.levels import Level
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.resection import checked_points, pose_from_points
from vgrd.model import Mount


@dataclass(frozen=True, slots=True, eq=False)
class PointSample:
    """One picture of a target with known points: points (n, 3) mm in the target, pixels (n, 2).

    features: pixels (2,) of points fixed to the target, by name; those count whose place is known, or
    that at least two samples show.
    """

    name: str
    base_from_wrist: Pose
    points_in_target: Array
    pixels: Array
    features: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class RecordingProblem:
    """Flange poses with evidence of the target, one a sample; `blank` says what is refined beside the poses.

    allow_unobservable: how many translations may stay open. start: the result of nearly the same samples.
    known: levels of noise that other evidence tells; each is a prior as wide as it is known.
    """

    mount: Mount
    names: Sequence[str]
    wrists: Sequence[Pose]
    evidence: Evidence
    cameras: Sequence[Pose]
    blank: HandEye = field(default_factory=HandEye)
    allow_unobservable: int = 0
    start: HandEyeResult | None = None
    known: tuple[Level, ...] = ()

    @property
    def feature_names(self) -> Sequence[str]:
        """Of the points that the state holds."""
        return self.evidence.places if isinstance(self.evidence, PointEvidence) else ()

    def chosen(self, indices: Sequence[int]) -> "RecordingProblem":
        """The same with some of the samples."""
        return replace(
            self,
            names=[self.names[i] for i in indices],
            wrists=[self.wrists[i] for i in indices],
            cameras=[self.cameras[i] for i in indices],
            evidence=self.evidence.chosen(indices),
        )


def poses_problem(
    mount: Mount, samples: Sequence[tuple[str, Pose, Pose]], *, allow_unobservable: int = 0
) -> RecordingProblem:
    """Samples with the pose of the target as somebody else measured it: name, robot, target."""
    cameras = [camera_from_target for _, _, camera_from_target in samples]
    return RecordingProblem(
        mount,
        [name for name, _, _ in samples],
        [base_from_wrist for _, base_from_wrist, _ in samples],
        PoseEvidence(cameras),
        cameras,
        allow_unobservable=allow_unobservable,
    )


def points_problem(
    mount: Mount,
    camera: CameraModel,
    samples: Sequence[PointSample],
    *,
    refine: bool = False,
    places: Mapping[str, FeaturePlace] | None = None,
    allow_unobservable: int = 0,
) -> RecordingProblem:
    """Pictures of a target with known points; places: of features, where known.

    Raises InputError that names the sample whose points give no pose.
    """
    cameras = [_own_pose(sample, camera) for sample in samples]
    sightings = [sample.features for sample in samples]
    found = first_places(sightings, cameras, camera, places or {})
    points = np.array([place.point_in_target for place in found.values()]).reshape(-1, 3)
    blank = HandEye(
        camera=camera,
        refines_camera=refine,
        points=points,
        prior_points=points,
        prior_sigma_mm=np.array([place.sigma_mm for place in found.values()]),
    )
    checked = [checked_points(s.points_in_target, s.pixels) for s in samples]
    evidence = PointEvidence(
        camera,
        [points for points, _ in checked],
        [pixels for _, pixels in checked],
        cameras,
        sightings,
        list(found),
    )
    return RecordingProblem(
        mount,
        [sample.name for sample in samples],
        [sample.base_from_wrist for sample in samples],
        evidence,
        cameras,
        blank,
        allow_unobservable,
    )


def _own_pose(sample: PointSample, camera: CameraModel) -> Pose:
    try:
        resection = pose_from_points(sample.points_in_target, sample.pixels, camera)
    except InputError as fault:
        raise InputError(f"sample {sample.name!r}: {fault}") from fault
    return resection.camera_from_target
