"""The paper's cell as equations, no pictures: recordings with known truth, by the thousand.

Experiment B (table 3): a camera that stands still, tag A on the flange, tag B on a turntable with
six targets on an 80 mm radius, touches with truncated normal noise. Studies and tests of
statistics use it; it shares no code with the methods that it judges.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.random import SeedSequence
from scipy.spatial.transform import Rotation

from fakes.world.arm_errors import EXACT_ARM, ArmErrors, deviated
from fakes.world.noise import COARSE, Vision, truncated_normal
from vgrd.geometry import Array, Pose
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

TAG_A = TagSpec("36h11", 0, 25.0)  # as in the fake cell
TAG_B = TagSpec("36h11", 1, 25.0)  # as in the fake cell
WORK_ROTATION = frozen_array(Rotation.from_euler("xyz", [np.pi, 0, 0.3]).as_matrix(), 3, 3)  # down
BORED_CENTER_MM = (
    0.02  # a guess: of a turntable whose centre was bored, per axis; stated where it is exact too
)
TOUCH_SIGMA_MM = 0.233  # the paper's, experiment B
_TRUNCATED_SIGMAS = 3.0  # the paper cuts them at 0.7 mm
_LEFT_OF_SIGMA = 0.98658  # standard deviation of a normal variable cut there
_UNEVEN_PART = (  # mm in CAD; two of them higher, as on a casting
    (80, 0, 0),
    (20, 65, 0),
    (-70, 35, 0),
    (-60, -40, 12),
    (15, -75, 0),
    (70, -45, 20),
)
_SECONDS_PER_SAMPLE = 5.0  # any: stamps only have to differ
_K = ((6486.0, 0.0, 2012.0), (0.0, 6486.0, 1518.0), (0.0, 0.0, 1.0))  # 12 mm on 1.85 um pixels


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """Where the camera saw the hole of a target: (2,) px; spin: index, None while touching."""

    target: str
    pixel: Array
    sigma_px: float
    spin: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRequest:
    """A picture of the turned object at run time, and the angle that nobody knows."""

    target: str
    angle_rad: float
    seen: Observation


class Simulation:
    """One cell; everything random comes from `seed`.

    axial_sigma_mm: of touches along the tool, None for the sigma across. one_axis: the wrist turns
    about its axis only. center_sigma_mm: how far CAD is off the axis of turning, per axis. tool:
    None for one whose touching tip works.
    """

    base_from_camera = Pose(  # 700 mm up, looks down obliquely
        Rotation.from_euler("xyz", [np.pi, 0.1, 0.2]).as_matrix(), np.array([350.0, 0, 700])
    )
    wrist_from_tag_a = Pose(  # beside the tool, faces the camera
        Rotation.from_euler("xyz", [np.pi, 0.05, -0.1]).as_matrix(), np.array([60.0, 20, 30])
    )
    object_from_tag_b = Pose(  # off the centre, turned and tilted: no number is special
        Rotation.from_euler("xyz", [0.02, -0.01, 0.7]).as_matrix(), np.array([30.0, 40, 10])
    )
    tcp_in_wrist = frozen_array((5, -8, 120), 3)  # a tool of 120 mm, a little off the axis
    center_in_base = frozen_array((350, 0, 50), 3)  # below the camera
    fixed_point_in_base = frozen_array((400, 100, 60), 3)  # beside the object, within reach
    standing = Pose(WORK_ROTATION, np.array([300.0, 60, 300]))  # aside

    def __init__(
        self,
        seed: int | SeedSequence,
        *,
        vision: Vision = COARSE,
        touch_sigma_mm: float = TOUCH_SIGMA_MM,
        axial_sigma_mm: float | None = None,
        arm: ArmErrors = EXACT_ARM,
        one_axis: bool = False,
        center_sigma_mm: float = 0.0,
        tool: Tool | None = None,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.vision = vision
        self.sigmas_mm = (touch_sigma_mm, axial_sigma_mm or touch_sigma_mm)
        self.arm = arm
        self._one_axis = one_axis
        self.tool = tool or Tool()
        self._field = arm.field(self.rng)
        self._stamp_s = 0.0
        self._center_sigma_mm = center_sigma_mm
        self._center_in_cad = np.zeros(3)
        if center_sigma_mm > 0:
            self._center_in_cad[:2] = self.rng.normal(size=2) * center_sigma_mm
        circle = np.arange(6) * np.pi / 3
        self.targets = {
            f"P{k + 1}": Target(
                k + 1, f"P{k + 1}", frozen_array((80 * np.cos(a), 80 * np.sin(a), 0), 3)
            )
            for k, a in enumerate(circle)
        }

    def put_uneven_part(self) -> None:
        """Put a part on the table whose holes are on no circle, and at two heights."""
        self.targets = {
            f"P{k}": Target(k, f"P{k}", frozen_array(point, 3))
            for k, point in enumerate(_UNEVEN_PART, 1)
        }

    def base_from_object(self, angle_rad: float) -> Pose:
        """Object on its turntable."""
        return Pose.from_rotvec((0.0, 0.0, angle_rad), self.center_in_base)

    def point(self, target: str, angle_rad: float) -> Array:
        """Where a target is, (3,) base, mm."""
        return self.base_from_object(angle_rad) @ self.targets[target].cad

    def flange(self, target: str, angle_rad: float, R: Array) -> Array:
        """Where the flange truly has to be for the work tip to meet a target, (3,) base, mm.

        R: (3, 3) orientation of the wrist.
        """
        return np.asarray(self.point(target, angle_rad) - R @ self._work_tip())

    def miss(self, request: SimulatedRequest, base_from_wrist: Pose) -> Array:
        """Work tip minus target, (3,) mm, after the arm was sent to `base_from_wrist`."""
        tip = self._true(base_from_wrist, self._draw()) @ self._work_tip()
        return np.asarray(tip - self.point(request.target, request.angle_rad))

    def wrist(self, spread_rad: float = 0.0) -> Array:
        """Work orientation (3, 3), turned at random within the spread about each axis."""
        spread = np.array([0, 0, 1.0]) if self._one_axis else np.ones(3)
        angles = self.rng.uniform(-1, 1, 3) * spread * spread_rad
        return np.asarray(WORK_ROTATION @ Rotation.from_euler("xyz", angles).as_matrix())

    def looks(self, count: int) -> tuple[Observation, ...]:
        """Hand-eye samples over the working volume."""
        observations = []
        for _ in range(count):
            turn = self.rng.uniform(-1, 1, 3) * (0.4, 0.4, 0.8)
            turn[:2] *= not self._one_axis
            R = WORK_ROTATION @ Rotation.from_euler("xyz", turn).as_matrix()
            position = np.array([350, 0, 250]) + self.rng.uniform(-100, 100, 3)
            observations.append(self.observe(Pose(R, position), 0.0))
        return tuple(observations)

    def spins(self, count: int) -> tuple[Observation, ...]:
        """Pictures of the turning object, the robot standing at one pose."""
        angles = np.linspace(0, 1.6 * np.pi, count)
        return self._rest(self.standing, [float(angle) for angle in angles])

    def watch(self, reported: Pose, angle_rad: float, count: int) -> tuple[Observation, ...]:
        """Pictures of one rest of the arm at `reported`; nothing moves."""
        return self._rest(reported, [angle_rad] * count)

    def _rest(self, reported: Pose, angles_rad: Sequence[float]) -> tuple[Observation, ...]:
        draw, since_s = self._draw(), self._stamp_s
        pictures = [self.observe(reported, angle, draw) for angle in angles_rad]
        return tuple(replace(picture, rest_since_s=since_s) for picture in pictures)

    def touch(self, target: str, R: Array, angle_rad: float = 0.0, *, tag_a: bool = True) -> Touch:
        """Touch a target with the wrist oriented as R (reported); tag_a: whether it is visible."""
        point = self.point(target, angle_rad)
        return self._touch(target, point, R, angle_rad, tag_a=tag_a)

    def points(
        self,
        count: int,
        spread_rad: float = np.radians(25),  # as TILT_RAD of the studies
        plan: Plan = Plan.CONVENTIONAL,
    ) -> tuple[Touch, ...]:
        """Touches beside the object with varied wrists, no picture: a fixed point, or the plan's surface."""
        places = {Plan.PLANE: ("plate", self._on_plate), Plan.SPHERE: ("ball", self._on_ball)}
        name, place = places.get(plan, ("spike", lambda: self.fixed_point_in_base))
        return tuple(
            self._touch(name, place(), self.wrist(spread_rad), None) for _ in range(count)
        )

    def _on_plate(self) -> Array:
        """Anywhere on a plate of 200 mm that leans a little, (3,) base."""
        across = self.rng.uniform(-100, 100, 2)
        slope = Rotation.from_euler("xyz", [0.1, -0.2, 0.0]).as_matrix()
        return np.asarray(self.fixed_point_in_base + slope[:, :2] @ across)

    def _on_ball(self) -> Array:
        """Anywhere on a ball of 20 mm radius but its lower third, where its stem is, (3,) base."""
        z, turn = self.rng.uniform(-1 / 3, 1), self.rng.uniform(-np.pi, np.pi)
        flat = np.sqrt(1 - z * z)
        side = np.array([flat * np.cos(turn), flat * np.sin(turn), z])
        return np.asarray(self.fixed_point_in_base + 20.0 * side)

    def holes(
        self,
        spins: Sequence[int | None],
        sigma_px: float = 0.1,  # a guess: 0.01 mm, as of a hole with a sharp rim
    ) -> tuple[Hole, ...]:
        """All holes as the camera sees them, object as in each spin (of 1.6 pi over 10) or still."""
        K = np.array(_K)
        holes = []
        for spin in spins:
            angle = 0.0 if spin is None else self.spin_angles[spin]
            for name in self.targets:
                ray = K @ (self.base_from_camera.inverse() @ self.point(name, angle))
                pixel = ray[:2] / ray[2] + self.rng.normal(size=2) * sigma_px
                holes.append(Hole(name, frozen_array(pixel, 2), sigma_px, spin))
        return tuple(holes)

    def record(
        self,
        *,
        looks: int = 8,  # as the paper's operator
        spins: int = 10,  # idem
        wrists: Sequence[Array] | None = None,
        names: Sequence[str] | None = None,
        turns_rad: Sequence[float] | None = None,
        points: int = 0,
        plan: Plan = Plan.JOINT,
    ) -> Recording:
        """A session; wrists: orientation of every touch, None for six alike; turns_rad: of the object then."""
        wrists = [WORK_ROTATION] * 6 if wrists is None else wrists
        every = list(self.targets)
        names = [every[i % 6] for i in range(len(wrists))] if names is None else names
        turns_rad = [0.0] * len(wrists) if turns_rad is None else turns_rad
        touched = zip(names, wrists, turns_rad, strict=True)
        self.spin_angles = [float(a) for a in np.linspace(0, 1.6 * np.pi, max(spins, 1))]
        return Recording(
            session="simulated",
            plan=plan,
            facts=self.facts(),
            looks=self.looks(looks),
            spins=self.spins(spins),
            touches=tuple(self.touch(name, R, turn_rad) for name, R, turn_rad in touched),
            points=self.points(points, plan=plan),
        )

    def request(self) -> SimulatedRequest:
        """The object turned at random, one picture from where the robot waits."""
        angle = float(self.rng.uniform(-np.pi, np.pi))
        target = f"P{self.rng.integers(6) + 1}"
        return SimulatedRequest(target, angle, self.observe(self.standing, angle))

    def facts(self) -> CellFacts:
        """What a cell file would tell."""
        return CellFacts(
            mount=Mount.EYE_TO_HAND,
            camera_matrix=frozen_array(_K, 3, 3),
            distortion=frozen_array((), 0),
            image_size_px=(4024, 3036),
            tag_a=TAG_A,
            tag_b=TAG_B,
            tool=self.tool,
            object=ObjectSpec(
                MappingProxyType(self.targets),
                center_in_object=frozen_array(self._center_in_cad, 3),
                center_sigma_mm=self._center_sigma_mm or BORED_CENTER_MM,
                cad_sigma_mm=0.0,
            ),
            robot_sigma_mm=max(float(np.hypot(self.arm.sigma_mm, self.arm.field_mm)), 1e-3),
            tag_a_sigma_mm=0.0,
            tag_b_sigma_mm=0.0,
        )

    def observe(
        self,
        reported: Pose,
        angle_rad: float,
        deviation: Array | None = None,
        *,
        tag_a: bool = True,
    ) -> Observation:
        """One picture of the tags, the arm standing where it reports `reported`.

        deviation: (6,) of the arm, None to draw one; tag_a: False while something hides it.
        """
        deviation = self._draw() if deviation is None else deviation
        camera_from_base = self.base_from_camera.inverse()
        A = camera_from_base @ self._true(reported, deviation) @ self.wrist_from_tag_a
        B = camera_from_base @ self.base_from_object(angle_rad) @ self.object_from_tag_b
        self._stamp_s += _SECONDS_PER_SAMPLE
        on_flange = self._see(TAG_A, A) if tag_a else None
        return Observation(reported, self._stamp_s, on_flange, self._see(TAG_B, B))

    def touch_miss(self) -> Array:
        """How far a touch is off what it touches, (3,) mm, in the wrist."""
        lateral, axial = self.sigmas_mm
        draws = truncated_normal(self.rng, _TRUNCATED_SIGMAS, 3)
        return np.asarray(draws * (lateral, lateral, axial))

    def _touch(
        self,
        target: str,
        point: Array,
        R: Array,
        angle_rad: float | None,
        *,
        tag_a: bool = True,
    ) -> Touch:
        miss = R @ self.touch_miss()
        draw = self._draw()
        flange = point + miss - R @ self.tcp_in_wrist
        for _ in range(3):
            error = self._true(Pose(R, flange), draw) @ self.tcp_in_wrist - (point + miss)
            flange = flange - error
        reported = Pose(R, flange)
        picture = None
        if angle_rad is not None:
            picture = self.observe(reported, angle_rad, draw, tag_a=tag_a)
        lateral, axial = (max(_LEFT_OF_SIGMA * sigma, 1e-3) for sigma in self.sigmas_mm)
        return Touch(target, reported, lateral, axial, picture)

    def _work_tip(self) -> Array:
        """Tip that works, (3,) mm, in the wrist."""
        return np.asarray(self.tcp_in_wrist + self.tool.work_from_touch_mm)

    def _draw(self) -> Array:
        return self.arm.deviation(self.rng)

    def _true(self, reported: Pose, deviation: Array) -> Pose:
        """Where the arm truly is: shifted, and turned about its flange."""
        return deviated(reported, self._field.tangent(reported.translation) + deviation)

    def _see(self, spec: TagSpec, truth: Pose) -> TagObservation:
        return self.vision.observe(self.rng, spec, truth)
