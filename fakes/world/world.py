"""One simulated world with known truth: arm, turntable, tags, faults; all fakes read it.

The world has no clock of its own: every call says what time it is (seconds of the caller's
monotonic clock). A `WorldSnapshot` holds what a picture of one instant needs, and crosses process
borders as JSON.
"""

import json
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from fakes.world.arm import PEAK_OVER_MEAN, Arm, minimum_jerk
from fakes.world.arm_errors import ErrorField
from fakes.world.layout import Layout
from fakes.world.noise import truncated_normal
from vgrd.geometry import Array, Pose
from vgrd.model import Target

TagName = Literal["a", "b"]
UNMOVED: tuple[float, ...] = (0.0,) * 6


@dataclass(frozen=True, slots=True)
class CellNoise:
    """How imperfect the world is; all zero is a perfect world.

    Touches: normal per axis, truncated (paper: 0.233 in +-0.7 mm). repeatability_mm: rms deviation
    per move. field_mm: largest deviation of the arm over its workspace. reading_mm: rms per axis
    of a reported position.
    """

    touch_sigma_mm: float = 0.233  # the paper's, experiment B
    touch_limit_mm: float = 0.7  # idem: three sigmas
    repeatability_mm: float = 0.03  # as UR states for the UR5e
    field_mm: float = 0.2  # a guess: an arm that was calibrated at the factory
    reading_mm: float = 0.0

    @classmethod
    def none(cls) -> "CellNoise":
        """Make a perfect arm and a perfect operator."""
        return cls(0.0, 0.7, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class WorldSnapshot:
    """All that a picture of one instant shows.

    flange: true base_from_wrist, (4, 4) row-major as 16 numbers; tag_b_shift: (x mm, y mm, rad) of
    tag B on the object; camera_shift: x, y, z mm and rotation vector, rad, of the camera in its own
    frame; covered: tags hidden by a hand; exposure: seed of the picture's noise.
    """

    flange: tuple[float, ...]
    table_angle_rad: float
    tag_b_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    camera_shift: tuple[float, ...] = UNMOVED
    covered: tuple[str, ...] = ()
    lights: bool = True
    exposure: int = 0

    @property
    def base_from_wrist(self) -> Pose:
        """The true flange."""
        return Pose.from_matrix(np.reshape(self.flange, (4, 4)))

    def base_from_tag(self, name: TagName, layout: Layout) -> Pose:
        """Find the true pose of tag "a" or "b" in the base."""
        if name == "a":
            return self.base_from_wrist.compose(layout.wrist_from_tag_a)
        x, y, turn = self.tag_b_shift
        shift = Pose.from_rotvec((0.0, 0.0, turn), (x, y, 0.0))
        return (
            layout.base_from_object(self.table_angle_rad)
            .compose(shift)
            .compose(layout.object_from_tag_b)
        )

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> "WorldSnapshot":
        """Undo `to_json`."""
        fields = json.loads(text)
        for name in ("flange", "tag_b_shift", "camera_shift", "covered"):
            fields[name] = tuple(fields[name])
        return cls(**fields)


@dataclass(frozen=True, slots=True)
class _Turn:
    start_rad: float
    end_rad: float
    started_s: float
    duration_s: float

    def angle(self, now_s: float) -> float:
        share = minimum_jerk(now_s - self.started_s, self.duration_s)
        return self.start_rad + share * (self.end_rad - self.start_rad)


class World:
    """The truth. `arm` moves; a seed makes everything repeatable; threads may share one world."""

    def __init__(
        self,
        layout: Layout,
        seed: int,
        noise: CellNoise | None = None,
        *,
        speed_mm_s: float = 250.0,  # the most while teaching by hand (ISO 10218-1)
        turn_rad_s: float = 1.0,
    ) -> None:
        noise = noise or CellNoise()
        self._turn_rad_s = turn_rad_s
        self.layout = layout
        self.noise = noise
        self.seed = seed
        field = (
            ErrorField.random(seed, noise.field_mm, layout.workspace_mm)
            if noise.field_mm
            else None
        )
        self.arm = Arm(
            layout.base_from_wrist_home,
            layout.wrist_from_pendant_tcp,
            seed=seed,
            repeatability_mm=noise.repeatability_mm,
            field=field,
            reading_noise_mm=noise.reading_mm,
            speed_mm_s=speed_mm_s,
            speed_rad_s=turn_rad_s,
        )
        self._rng = np.random.default_rng((seed, 3))
        self._turn = _Turn(0.0, 0.0, 0.0, 0.0)
        self._covered: frozenset[TagName] = frozenset()
        self._tag_b_shift = (0.0, 0.0, 0.0)
        self._camera_shift = UNMOVED
        self._lights = True
        self._exposures = 0
        self._lock = threading.Lock()

    @property
    def targets(self) -> Mapping[str, Target]:
        """CAD targets by name."""
        return self.layout.targets

    def reported_flange(self, now_s: float) -> Pose:
        """Tell what the robot controller says about its flange."""
        with self._lock:
            return self.arm.reported_flange(now_s)

    def true_flange(self, now_s: float) -> Pose:
        """Where the flange really is."""
        return self.arm.true_flange(now_s)

    def table_angle(self, now_s: float) -> float:
        """Tell the true angle of the turntable, rad."""
        return self._turn.angle(now_s)

    def turn_table(self, angle_rad: float, now_s: float) -> float:
        """Start turning the table to an angle; returns the time at which it stands."""
        with self._lock:
            angle = self._turn.angle(now_s)
            duration = PEAK_OVER_MEAN * abs(angle_rad - angle) / self._turn_rad_s
            self._turn = _Turn(angle, angle_rad, now_s, duration)
            return now_s + duration

    def move_flange(self, base_from_wrist: Pose, now_s: float) -> float:
        """Start a move of the flange; returns the time of arrival."""
        with self._lock:
            return self.arm.move_flange(base_from_wrist, now_s)

    def move_tcp(self, base_from_tcp: Pose, now_s: float) -> float:
        """Start a move of the controller's active TCP; returns the time of arrival."""
        with self._lock:
            return self.arm.move_tcp(base_from_tcp, now_s)

    def jog_onto(self, target: str, wrist_rotation: Array, now_s: float) -> float:
        """Jog as an operator does until he believes that the true tip is on a target.

        target: a CAD name or `FIXED_POINT`; wrist_rotation: (3, 3) base from wrist, kept. The tip
        ends on the target up to the touch noise. Returns the time of arrival; read
        `reported_flange` then.
        """
        with self._lock:
            angle = self._turn.angle(now_s)
            tip = self.layout.target_in_base(target, angle) + self._touch_noise()
            origin = tip - wrist_rotation @ self.layout.tcp_in_wrist
            return self.arm.jog_to_true(Pose(wrist_rotation, origin), now_s)

    def miss(self, target: str, now_s: float) -> Array:
        """Measure true tip minus true target (3,), mm, base frame."""
        tip = self.true_flange(now_s).apply(self.layout.tcp_in_wrist)
        return np.asarray(tip - self.layout.target_in_base(target, self.table_angle(now_s)))

    def miss_at(self, base_from_wrist: Pose, target: str, angle_rad: float) -> Array:
        """Tell the miss (3,) mm had the arm reported this pose at that table angle, repeating perfectly."""
        tip = self.arm.true_at(base_from_wrist).apply(self.layout.tcp_in_wrist)
        return np.asarray(tip - self.layout.target_in_base(target, angle_rad))

    def cover(self, *tags: TagName) -> None:
        """Lay a hand on these tags; without arguments all are free again."""
        self._covered = frozenset(tags)

    def shift_tag_b(self, x_mm: float, y_mm: float, turn_rad: float = 0.0) -> None:
        """Slip tag B on the object, measured from its place in the layout."""
        self._tag_b_shift = (x_mm, y_mm, turn_rad)

    def shift_camera(self, shift: tuple[float, ...] = UNMOVED) -> None:
        """Knock the camera: x, y, z mm and rotation vector, rad, in its frame of the layout."""
        self._camera_shift = shift

    def switch_lights(self, *, on: bool) -> None:
        """Switch the cell's light."""
        self._lights = on

    def snapshot(self, now_s: float) -> WorldSnapshot:
        """Freeze what the camera sees now; every call counts as one exposure."""
        with self._lock:
            self._exposures += 1
            return WorldSnapshot(
                flange=tuple(self.arm.true_flange(now_s).matrix().ravel().tolist()),
                table_angle_rad=self._turn.angle(now_s),
                tag_b_shift=self._tag_b_shift,
                camera_shift=self._camera_shift,
                covered=tuple(sorted(self._covered)),
                lights=self._lights,
                exposure=self.seed * 1_000_003 + self._exposures,
            )

    def _touch_noise(self) -> Array:
        """Draw how far the operator is off, (3,) mm."""
        sigma, limit = self.noise.touch_sigma_mm, self.noise.touch_limit_mm
        if not sigma:
            return np.zeros(3)
        return sigma * truncated_normal(self._rng, limit / sigma, 3)
