"""One [[sample]] of a dataset: its numbers and files as poses, points and paths."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.pose_formats import MM_PER, written_pose
from vgrd.solving.datasets.reading.document import CameraPosesTable, SampleTable
from vgrd.solving.datasets.reading.points import read_points
from vgrd.solving.flange_poses import PosesTable
from vgrd.vision.print.boards import BoardObservation

_SOURCES = ("image", "points", "camera_from_target", "point_in_camera")
_KEYS = "image, points, camera_from_target (or rvec and tvec), point_in_camera"


@dataclass(frozen=True, slots=True, eq=False)
class PointInCamera:
    """The place (3,) of the tool's point in the camera, mm."""

    place: Array


Source = Path | BoardObservation | Pose | PointInCamera


@dataclass(frozen=True, slots=True, eq=False)
class DatasetSample:
    """A flange pose and what the camera saw: a picture, points, a pose or a point; features: pixels (2,)."""

    name: str
    base_from_wrist: Pose
    source: Source
    features: Mapping[str, Array] = field(default_factory=dict)


def kinds_of(row: SampleTable) -> list[str]:
    """Which of the sources a sample has; OpenCV's rvec and tvec are a camera_from_target."""
    kinds = [kind for kind in _SOURCES if getattr(row, kind) is not None]
    if (row.rvec is not None or row.tvec is not None) and "camera_from_target" not in kinds:
        kinds.append("camera_from_target")
    return kinds


class SampleReader:
    """Turns checked rows into samples; appends what is wrong with their numbers and files."""

    def __init__(
        self,
        folder: Path,
        poses: PosesTable | None,
        camera_poses: CameraPosesTable | None,
        faults: list[str],
    ) -> None:
        self._folder = folder
        self._poses = poses
        self._camera = camera_poses or CameraPosesTable()
        self._faults = faults

    def read(self, row: SampleTable, label: str) -> DatasetSample | None:
        """The sample, or None with its faults appended."""
        fault_count = len(self._faults)
        kinds = kinds_of(row)
        if len(kinds) != 1:
            has = " and ".join(kinds) or "none"
            self._faults.append(f"{label}: needs exactly one of {_KEYS}, has {has}")
        pose = self._pose(row, label)
        source = self._source(row, kinds[0], label) if kinds else None
        if len(self._faults) > fault_count or pose is None or source is None:
            return None
        features = {name: np.array(pixel) for name, pixel in row.features.items()}
        return DatasetSample(row.name, pose, source, features)

    def _pose(self, row: SampleTable, label: str) -> Pose | None:
        if self._poses is None:
            return None
        try:
            return written_pose(row.pose, self._poses.rotation, self._poses.unit)
        except InputError as error:
            self._faults.append(f"{label}.pose: {error}")
            return None

    def _source(self, row: SampleTable, kind: str, label: str) -> Source | None:
        try:
            match kind:
                case "camera_from_target":
                    return self._camera_from_target(row)
                case "point_in_camera":
                    per_mm = MM_PER[self._camera.unit or "mm"]
                    return PointInCamera(per_mm * np.array(row.point_in_camera, dtype=np.float64))
            path = self._file(str(getattr(row, kind)))
            return path if kind == "image" else read_points(path)
        except InputError as error:
            self._faults.append(f"{label}.{kind}: {error}")
            return None

    def _file(self, name: str) -> Path:
        path = self._folder / name
        if "\0" in name or not path.is_file():
            raise InputError(f"no such file: {path} (paths count from the dataset's folder)")
        return path

    def _camera_from_target(self, row: SampleTable) -> Pose:
        unit = self._camera.unit or (self._poses.unit if self._poses else "mm")
        if row.camera_from_target is None:
            if row.rvec is None or row.tvec is None:
                raise InputError("rvec and tvec belong together: add the other one")
            turn = Rotation.from_rotvec(np.array(row.rvec)).as_matrix()
            return Pose(turn, MM_PER[unit] * np.array(row.tvec))
        if row.rvec is not None or row.tvec is not None:
            raise InputError("rvec and tvec say the same again: keep one of both")
        return self._posed(row.camera_from_target, unit)

    def _posed(self, values: Sequence[float], unit: str) -> Pose:
        try:
            return written_pose(values, self._camera.rotation, unit)
        except InputError as error:
            if len(values) in (12, 16):
                raise InputError(f"{error}; 16 numbers, row by row") from error
            raise
