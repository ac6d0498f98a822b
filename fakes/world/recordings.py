"""Simulated recordings without pictures or processes: a cell with known truth, for tests and studies.

The cell is experiment B of the paper: a camera that stands still, tag A on the flange, tag B on a
turntable with six targets on an 80 mm radius, touches with truncated normal noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from vgrd.geometry import Array, Pose, exp_rotation, hat
from vgrd.model import (
    CellFacts,
    Mount,
    ObjectSpec,
    Observation,
    Plan,
    Recording,
    TagObservation,
    TagSpec,
    Target,
    Tool,
    Touch,
    frozen_array,
)

TAG_A = TagSpec("36h11", 0, 25.0)
TAG_B = TagSpec("36h11", 1, 25.0)
_DOWN = exp_rotation((0.0, 0.0, 0.3)) @ np.diag([1.0, -1.0, -1.0])
_TRUNCATED = 3.0


@dataclass(frozen=True, slots=True)
class Vision:
    """Noise of a tag's pose: sigma across and along the view, mm, and of its rotation, degrees."""

    lateral_mm: float = 0.001
    depth_mm: float = 0.02
    rotation_deg: float = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedCell:
    """Truth and noise of one cell; everything random comes from `rng`."""

    rng: np.random.Generator
    touch_sigma_mm: float = 0.233
    robot_sigma_mm: float = 0.0
    vision: Vision = Vision()
    base_from_camera: Pose = field(
        default_factory=lambda: Pose.from_rotvec((3.0, 0.15, 0.1), (350.0, 60.0, 700.0))
    )
    wrist_from_tag_a: Pose = field(
        default_factory=lambda: Pose.from_rotvec((3.1, 0.05, -0.1), (60.0, 20.0, 30.0))
    )
    object_from_tag_b: Pose = field(
        default_factory=lambda: Pose.from_rotvec((0.02, -0.01, 0.7), (30.0, 40.0, 10.0))
    )
    tcp_in_wrist: Array = field(default_factory=lambda: np.array([5.0, -8.0, 120.0]))
    tool: Tool = field(default_factory=Tool)

    def base_from_object(self, angle_rad: float) -> Pose:
        """Object on its turntable, axis upright at (350, 0, 50)."""
        return Pose.from_rotvec((0.0, 0.0, angle_rad), (350.0, 0.0, 50.0))

    def targets(self) -> dict[str, Target]:
        """Six points in the plane of the object."""
        angles = np.arange(6) * np.pi / 3
        return {
            f"P{k + 1}": Target(
                k + 1, f"P{k + 1}", frozen_array((80 * np.cos(a), 80 * np.sin(a), 0), 3)
            )
            for k, a in enumerate(angles)
        }

    def flange(self, target: str, angle_rad: float, R: Array, *, work: bool = True) -> Array:
        """Where the flange truly has to be for the work (or touch) tip to meet the target."""
        point = self.base_from_object(angle_rad) @ self.targets()[target].point_in_object
        offset = self.tool.work_from_touch_mm if work else np.zeros(3)
        return np.asarray(point - R @ (self.tcp_in_wrist + offset))

    def observe(
        self, base_from_wrist: Pose, angle_rad: float, *, tag_a: bool = True
    ) -> Observation:
        """One picture, both tags with noise."""
        camera_from_base = self.base_from_camera.inverse()
        A = camera_from_base @ base_from_wrist @ self.wrist_from_tag_a
        B = camera_from_base @ self.base_from_object(angle_rad) @ self.object_from_tag_b
        return Observation(
            base_from_wrist,
            0.0,
            self._see(TAG_A, A) if tag_a else None,
            self._see(TAG_B, B),
        )

    def touch(self, target: str, R: Array, angle_rad: float = 0.0, *, tag_a: bool = True) -> Touch:
        """One touch of a target with the wrist oriented as R."""
        flange = self.flange(target, angle_rad, R, work=False) + self._touch_noise()
        wrist = Pose(R, flange)
        sigma = max(self.touch_sigma_mm, 1e-3)
        observation = self.observe(wrist, angle_rad, tag_a=tag_a)
        return Touch(target, self._reported(wrist), sigma, sigma, observation)

    def tilted(self, spread_rad: float = 0.44) -> Array:
        """Working orientation, tilted and turned at random within the spread."""
        return _DOWN @ exp_rotation(self.rng.uniform(-spread_rad, spread_rad, 3))

    def looks(self, count: int) -> tuple[Observation, ...]:
        """Hand-eye samples over the working volume."""
        out = []
        for _ in range(count):
            position = self.rng.uniform((250, -100, 150), (450, 100, 350))
            turn = exp_rotation(self.rng.uniform(-1, 1, 3) * (0.4, 0.4, 0.8))
            wrist = Pose(_DOWN @ turn, position)
            seen = self.observe(wrist, 0.0)
            out.append(Observation(self._reported(wrist), 0.0, seen.tag_a, seen.tag_b))
        return tuple(out)

    def spins(self, count: int) -> tuple[Observation, ...]:
        """Pictures of the turning object from one flange pose."""
        wrist = Pose(_DOWN, np.array([300.0, 60.0, 300.0]))
        angles = np.linspace(0, 1.6 * np.pi, count)
        return tuple(self.observe(wrist, float(angle)) for angle in angles)

    def points(self, count: int) -> tuple[Touch, ...]:
        """Touches of one fixed point with tilted wrists (conventional TCP)."""
        sigma = max(self.touch_sigma_mm, 1e-3)
        out = []
        for _ in range(count):
            R = self.tilted()
            at = np.array([400.0, 100.0, 60.0]) + self._touch_noise()
            wrist = self._reported(Pose(R, at - R @ self.tcp_in_wrist))
            out.append(Touch("pin", wrist, sigma, sigma, None))
        return tuple(out)

    def record(
        self,
        *,
        plan: Plan = Plan.SPECIAL,
        wrists: Sequence[Array] | None = None,
        looks: int = 8,
        spins: int = 10,
        points: int = 0,
        center: bool = True,
    ) -> Recording:
        """Whole session; wrists: orientation of every touch, None for six alike."""
        orientations = [_DOWN] * 6 if wrists is None else list(wrists)
        names = list(self.targets())
        return Recording(
            session="simulated",
            plan=plan,
            facts=CellFacts(
                mount=Mount.EYE_TO_HAND,
                camera_matrix=frozen_array([[6486, 0, 2012], [0, 6486, 1518], [0, 0, 1]], 3, 3),
                distortion=frozen_array((), 0),
                image_size_px=(4024, 3036),
                tag_a=TAG_A,
                tag_b=TAG_B,
                tool=self.tool,
                object=ObjectSpec(
                    MappingProxyType(self.targets()),
                    center_in_object=frozen_array((0, 0, 0), 3) if center else None,
                ),
                robot_sigma_mm=max(self.robot_sigma_mm, 1e-3),
            ),
            looks=self.looks(looks),
            spins=self.spins(spins),
            touches=tuple(
                self.touch(names[i % len(names)], R) for i, R in enumerate(orientations)
            ),
            points=self.points(points),
        )

    def _touch_noise(self) -> Array:
        noise = self.rng.normal(size=3)
        while (np.abs(noise) > _TRUNCATED).any():
            noise = np.where(np.abs(noise) > _TRUNCATED, self.rng.normal(size=3), noise)
        return np.asarray(noise * self.touch_sigma_mm)

    def _reported(self, wrist: Pose) -> Pose:
        noise = self.rng.normal(size=3) * self.robot_sigma_mm
        return Pose(wrist.rotation, wrist.translation + noise)

    def _see(self, spec: TagSpec, truth: Pose) -> TagObservation:
        v = self.vision
        shift = np.array([v.lateral_mm, v.lateral_mm, v.depth_mm])
        turn = np.radians(v.rotation_deg)
        R = truth.rotation @ exp_rotation(self.rng.normal(size=3) * turn)
        seen = Pose(R, truth.translation + self.rng.normal(size=3) * shift)
        G = np.eye(6)
        G[:3, 3:] = hat(truth.translation)
        own = np.diag([*shift**2, turn**2, turn**2, turn**2])
        corners = np.zeros((4, 2))
        return TagObservation(spec, seen, frozen_array(G @ own @ G.T, 6, 6), corners, 0.0)


def fixed_wrist() -> Array:
    """Orientation (3, 3) of the wrist in untilted touches and at work."""
    return _DOWN.copy()
