"""DATASET.toml and the files it names, checked: every fault of all of them in one message."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vgrd.documents.tables import named_rows, parse, tables_of
from vgrd.documents.toml import one_word, read_toml, unknown_keys
from vgrd.errors import ConfigError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.pose_formats import robot_numbers
from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.model import Mount
from vgrd.solving.datasets.boards import read_target
from vgrd.solving.datasets.features import Places, read_features
from vgrd.solving.datasets.reading.cameras import read_dataset_camera
from vgrd.solving.datasets.reading.document import (
    CameraPosesTable,
    SampleTable,
    TcpTable,
)
from vgrd.solving.datasets.reading.sample_reading import DatasetSample, SampleReader, kinds_of
from vgrd.solving.datasets.reading.samples_table import with_samples_table
from vgrd.solving.flange_poses import MIN_SAMPLES, PosesTable, arm_faults, equal_pose_faults
from vgrd.vision.print.boards import TargetSpec
from vgrd.vision.print.targets import TagGrid

_TABLES = (
    *("mount", "camera", "poses", "camera_poses", "tcp_in_wrist", "target", "feature"),
    *("samples", "sample"),
)
_MOST = 1000  # samples, each left out once: minutes on one core; the noise of a few dozen is known already


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """A checked dataset; camera and target are None where the samples need none.

    pose_values: the numbers of the poses as written, for the search of a wrong convention, matrices as
    quaternions; pose_format, camera_format: as the file names them, "" where it has no such poses. features:
    places on the target by name, None where unknown. tcp_in_wrist (3,): the point of the tool that
    samples with a point show, mm, None where it is to be estimated. picture_px: (width, height) to which
    the intrinsics belong, None where that is not told.
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
    tcp_in_wrist: Array | None = None
    picture_px: tuple[int, int] | None = None
    pose_format: str = ""
    camera_format: str = ""


def load_dataset(path: Path) -> Dataset:
    """Read and check a dataset; ConfigError holds every fault, each with its key and remedy."""
    data = read_toml(path, "a DATASET.toml")
    faults = unknown_keys(data, _TABLES)
    data = with_samples_table(data, path.resolve().parent, faults)
    mount = _mount(data, faults)
    poses = parse(PosesTable, data.get("poses", {}), "poses", faults)
    camera_poses = parse(CameraPosesTable, data.get("camera_poses", {}), "camera_poses", faults)
    tcp = _tcp(data, faults)
    _check_count(path, data)
    rows = _sample_rows(data, faults)
    reader = SampleReader(path.resolve().parent, poses, camera_poses, faults)
    samples = [reader.read(row, label) for label, row in rows]
    kinds = {kind for _, row in rows for kind in kinds_of(row)}
    for alone in {"camera_from_target", "point_in_camera"} & kinds:
        if len(kinds) > 1:
            others = " or ".join(sorted(kinds - {alone}))
            faults.append(f"sample: {alone} cannot be mixed with {others}; split the dataset")
            break
    pictures = [s.source for s in samples if s is not None and isinstance(s.source, Path)]
    camera = read_dataset_camera(data, kinds, path.resolve().parent, pictures, faults)
    target = _target(data, kinds, faults)
    features = read_features(data, rows, target, faults)
    good = [sample for sample in samples if sample is not None]
    if poses is not None:
        faults += arm_faults([(s.name, s.base_from_wrist) for s in good], poses.unit, "sample")
        cameras = [(s.name, s.source) for s in good if isinstance(s.source, Pose)]
        faults += equal_pose_faults(cameras, "sample.camera_from_target", "camera")
    if faults or mount is None or poses is None:
        raise ConfigError(str(path), faults)
    numbers = [
        robot_numbers(row.pose, sample.base_from_wrist, poses.rotation, poses.unit)
        for (_, row), sample in zip(rows, good, strict=True)
    ]
    return Dataset(
        path=path,
        mount=mount,
        camera=camera.model if camera else None,
        refine=camera is not None and camera.refine,
        target=target,
        samples=tuple(good),
        unit=poses.unit,
        rotation=numbers[0][1],
        pose_values=tuple(values for values, _ in numbers),
        features=features,
        tcp_in_wrist=tcp,
        picture_px=camera.picture_px if camera else None,
        pose_format=poses.rotation,
        camera_format=_camera_format(rows, camera_poses),
    )


def _mount(data: dict[str, Any], faults: list[str]) -> Mount | None:
    example = " or ".join(repr(str(mount)) for mount in Mount)
    word = one_word(data, "mount", tuple(Mount), example, faults)
    return None if word is None else Mount(word)


def _check_count(path: Path, data: dict[str, Any]) -> None:
    """Raise ConfigError for more samples than are solved; points of a 3D camera may be many."""
    tables = data.get("sample")
    if not isinstance(tables, list) or len(tables) <= _MOST:
        return
    if not all(isinstance(table, dict) and "point_in_camera" in table for table in tables):
        every = -(-len(tables) // _MOST)
        fault = f"sample: {len(tables)} given, at most {_MOST} are solved: keep one of {every}"
        raise ConfigError(str(path), [fault])


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


def _camera_format(
    rows: list[tuple[str, SampleTable]], camera_poses: CameraPosesTable | None
) -> str:
    """How camera_from_target is written; "" where no sample has it."""
    if any(row.camera_from_target is None for _, row in rows):
        return ""
    return (camera_poses or CameraPosesTable()).rotation


def _tcp(data: dict[str, Any], faults: list[str]) -> Array | None:
    """tcp_in_wrist (3,), mm; the flange's centre where it is not given, None where it is unknown."""
    value = data.get("tcp_in_wrist", [0.0] * 3)
    if value == "unknown":
        return None
    table = parse(TcpTable, {"tcp_in_wrist": value}, "", faults)
    return np.zeros(3) if table is None else np.array(table.tcp_in_wrist, dtype=np.float64)


def _target(
    data: dict[str, Any], kinds: set[str], faults: list[str]
) -> TargetSpec | TagGrid | None:
    table = data.get("target")
    if table is None:
        if "image" in kinds:
            faults.append("target: is missing; samples with an image need [target] type, ...")
        return None
    return read_target(table, faults)
