"""Synthetic recordings with known truth, written as a user would write them."""

import json
from dataclasses import dataclass, field

import numpy as np
import pytest

from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.rotation_formats import RotationFormat, rotation_to
from vgrd.model import Mount

K = np.array([[1400.0, 0, 630], [0, 1405.0, 470], [0, 0, 1]])
GRID = np.array([(25.0 * x, 25.0 * y, 0.0) for y in range(5) for x in range(6)])


@dataclass
class Recording:
    """Truth and the samples that follow from it; `write` makes a DATASET.toml of them."""

    mount: Mount = Mount.EYE_TO_HAND
    count: int = 8
    seed: int = 3
    camera: CameraModel = field(default_factory=lambda: CameraModel(K, np.zeros(0), (1260, 940)))

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        middle = Pose.from_rotvec([0, 0, 0], GRID.mean(0)).inverse()
        if self.mount is Mount.EYE_TO_HAND:
            self.X = Pose.from_rotvec([2.0, -0.4, 0.2], [900, 150, 700])
            self.Y = Pose.from_rotvec([0.2, 2.9, -0.3], [15, -20, 130]) @ middle
        else:
            self.X = Pose.from_rotvec([0.1, -0.05, 1.4], [40, -70, 90])
            self.Y = Pose.from_rotvec([3.0, 0.1, 0.2], [600, 100, 20]) @ middle
        self.robot, self.seen = [], []
        for _ in range(self.count):
            turn = Pose.from_rotvec(rng.normal(0, 0.35, 3))
            shift = np.array([*rng.uniform(-60, 60, 2), rng.uniform(450, 700)])
            camera_from_target = Pose(np.eye(3), shift) @ turn @ middle
            move = self.X @ camera_from_target @ self.Y.inverse()
            self.robot.append(move if self.mount is Mount.EYE_TO_HAND else move.inverse())
            self.seen.append(camera_from_target)

    def pixels(self, scale=1.0, sigma_px=0.0):
        """Pixels (n, 2) of every sample, target larger by `scale`, with noise."""
        rng = np.random.default_rng(self.seed + 1)
        return [
            self.camera.project(pose @ (scale * GRID)) + rng.normal(0, sigma_px, (len(GRID), 2))
            for pose in self.seen
        ]

    def write(
        self,
        folder,
        seen,
        *,
        rotation=RotationFormat.QUATERNION_XYZW,
        unit="m",
        matrix=K,
        refine=False,
        mount=None,
        target=(),
    ):
        """seen: for every sample the line that says what the camera saw."""
        per_mm = {"m": 1e-3, "mm": 1.0}[unit]
        fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
        lines = [
            f'mount = "{mount or self.mount}"',
            "[camera]",
            f"matrix = [{fx}, {fy}, {cx}, {cy}]",
            f"refine = {str(refine).lower()}",
            "[poses]",
            f'unit = "{unit}"',
            f'rotation = "{rotation}"',
            *target,
        ]
        for number, (pose, line) in enumerate(zip(self.robot, seen, strict=True)):
            values = [*pose.translation * per_mm, *rotation_to(pose.rotation, rotation)]
            lines += ["[[sample]]", f'name = "{number}"', f"pose = {[float(v) for v in values]}"]
            lines.append(line)
        path = folder / "dataset.toml"
        path.write_text("\n".join(lines) + "\n")
        return path

    def write_points(self, folder, *, pixels=None, points=GRID, **options):
        """Samples as points csv."""
        seen = []
        for number, uv in enumerate(pixels or self.pixels()):
            rows = ["x_mm,y_mm,z_mm,u_px,v_px"]
            rows += [
                ",".join(f"{v:.9g}" for v in (*p, *q)) for p, q in zip(points, uv, strict=True)
            ]
            (folder / f"{number}.csv").write_text("\n".join(rows) + "\n")
            seen.append(f'points = "{number}.csv"')
        return self.write(folder, seen, **options)

    def write_matrices(self, folder, *, unit="m", **options):
        """Samples as camera_from_target."""
        per_mm = {"m": 1e-3, "mm": 1.0}[unit]
        seen = []
        for pose in self.seen:
            matrix = pose.matrix()
            matrix[:3, 3] *= per_mm
            seen.append(f"camera_from_target = {matrix.ravel().tolist()}")
        return self.write(folder, seen, unit=unit, **options)


@pytest.fixture
def recording():
    """Eight samples, eye-to-hand."""
    return Recording()


@pytest.fixture
def make_recording():
    """The class, for other mounts and counts."""
    return Recording


@pytest.fixture
def plain():
    """Round trip through JSON text: NaN is refused."""
    return lambda solution: json.loads(json.dumps(solution.to_json(), allow_nan=False))
