"""DATASET.toml and the files it names, checked: every fault of all of them in one message."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.documents.tables import named_rows, parse, tables_of
from vgrd.documents.toml import one_word, read_toml, unknown_keys
from vgrd.errors import ConfigError, InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.rotation_formats import RotationFormat, pose_from
from vgrd.model import Mount
from vgrd.solving.datasets.boards import read_target
from vgrd.solving.datasets.cameras import read_dataset_camera
from vgrd.solving.datasets.document import SampleTable
from vgrd.solving.datasets.features import Places, read_features
from vgrd.solving.datasets.points import read_points
from vgrd.solving.flange_poses import MIN_SAMPLES, PosesTable, arm_faults, equal_pose_faults
from vgrd.vision.print.boards import BoardObservation, TargetSpec
from vgrd.vision.print.targets import TagGrid

_TABLES = ("mount", "camera", "poses", "target", "feature", "sample")
_SOURCES = ("image", "points", "camera_from_target")
_MM_PER = {"mm": 1.0, "m": 1000.0}  # by definition


@dataclass(frozen=True, slots=True, eq=False)
class DatasetSample:
    """A flange pose and what the camera saw: a picture, points or a pose; features: pixels (2,)."""

    name: str
    base_from_wrist: Pose
    source: Path | BoardObservation | Pose
    features: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """A checked dataset; camera and target are None where the samples need none.

    pose_values: the numbers of the poses as written, for the search of a wrong convention. features:
    places on the target by name, None where unknown.
    """

    path: Path
    mount: Mount
    camera: CameraModel | None
    refine: bool
    target: TargetSpec | TagGrid | None
    samples: tuple[DatasetSample, ...]
    unit: str
    rotation: RotationFormat
    pose_values: tuple[tuple[float, ...], ...]
    features: Places


def load_dataset(path: Path) -> Dataset:
    """Read and check a dataset; ConfigError holds every fault, each with its key and remedy."""
    data = read_toml(path, "a DATASET.toml")
    faults = unknown_keys(data, _TABLES)
    mount = _mount(data, faults)
    poses = parse(PosesTable, data.get("poses", {}), "poses", faults)
    rows = _sample_rows(data, faults)
    reader = _SampleReader(path.resolve().parent, poses, faults)
    samples = [reader.read(row, label) for label, row in rows]
    kinds = {kind for _, row in rows for kind in _SOURCES if getattr(row, kind) is not None}
    if "camera_from_target" in kinds and len(kinds) > 1:
        faults.append(
            "sample: camera_from_target cannot be mixed with image or points; split the dataset"
        )
    camera = read_dataset_camera(data, kinds, path.resolve().parent, faults)
    target = _target(data, kinds, faults)
    features = read_features(data, rows, target, faults)
    good = [sample for sample in samples if sample is not None]
    if poses is not None:
        faults += arm_faults([(s.name, s.base_from_wrist) for s in good], poses.unit, "sample")
        cameras = [(s.name, s.source) for s in good if isinstance(s.source, Pose)]
        faults += equal_pose_faults(cameras, "sample.camera_from_target", "camera")
    if faults or mount is None or poses is None:
        raise ConfigError(str(path), faults)
    return Dataset(
        path=path,
        mount=mount,
        camera=camera[0] if camera else None,
        refine=camera is not None and camera[1],
        target=target,
        samples=tuple(good),
        unit=poses.unit,
        rotation=RotationFormat(poses.rotation),
        pose_values=tuple(tuple(row.pose) for _, row in rows),
        features=features,
    )


def _mount(data: dict[str, Any], faults: list[str]) -> Mount | None:
    example = " or ".join(repr(str(mount)) for mount in Mount)
    word = one_word(data, "mount", tuple(Mount), example, faults)
    return None if word is None else Mount(word)


def _sample_rows(data: dict[str, Any], faults: list[str]) -> list[tuple[str, SampleTable]]:
    """The [[sample]] tables that can be read, each with the words that name it in a message."""
    tables = tables_of(data, "sample", faults)
    if tables is None:
        return []
    if len(tables) < MIN_SAMPLES:
        faults.append(
            f"sample: {len(tables)} given, at least {MIN_SAMPLES} are needed (10 to 20 are good)"
        )
    return named_rows(SampleTable, "sample", tables, faults)


def _target(
    data: dict[str, Any], kinds: set[str], faults: list[str]
) -> TargetSpec | TagGrid | None:
    table = data.get("target")
    if table is None:
        if "image" in kinds:
            faults.append("target: is missing; samples with an image need [target] type, ...")
        return None
    return read_target(table, faults)


class _SampleReader:
    """Turns checked rows into samples; appends what is wrong with their numbers and files."""

    def __init__(self, folder: Path, poses: PosesTable | None, faults: list[str]) -> None:
        self._folder = folder
        self._poses = poses
        self._faults = faults

    def read(self, row: SampleTable, label: str) -> DatasetSample | None:
        """The sample, or None with its faults appended."""
        fault_count = len(self._faults)
        kinds = [kind for kind in _SOURCES if getattr(row, kind) is not None]
        if len(kinds) != 1:
            self._faults.append(
                f"{label}: needs exactly one of {', '.join(_SOURCES)}, has "
                + (" and ".join(kinds) or "none")
            )
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
            return pose_from(row.pose, RotationFormat(self._poses.rotation), self._poses.unit)
        except InputError as error:
            self._faults.append(f"{label}.pose: {error}")
            return None

    def _source(
        self, row: SampleTable, kind: str, label: str
    ) -> Path | BoardObservation | Pose | None:
        try:
            if row.camera_from_target is not None:
                return self._matrix(row.camera_from_target)
            path = self._file(str(getattr(row, kind)))
            return path if kind == "image" else read_points(path)
        except InputError as error:
            self._faults.append(f"{label}.{kind}: {error}")
            return None

    def _file(self, name: str) -> Path:
        path = self._folder / name
        if not path.is_file():
            raise InputError(f"no such file: {path} (paths count from the dataset's folder)")
        return path

    def _matrix(self, numbers: Sequence[float]) -> Pose | None:
        matrix = np.array(numbers).reshape(4, 4)
        matrix[:3, 3] *= _MM_PER[self._poses.unit] if self._poses else 1.0
        try:
            return Pose.from_matrix(matrix)
        except InputError as error:
            raise InputError(f"{error}; 16 numbers, row by row") from error
