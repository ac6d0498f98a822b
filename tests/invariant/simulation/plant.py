"""The truth: where arm, table, object, tags and camera are, and where the flange must go; no estimate here.

Everything that people and accidents do to a cell is a method or a field. What was true a moment ago is
remembered for `REMEMBERED_S`, since promises speak of what was true then.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from fakes.world.arm import PEAK_OVER_MEAN, minimum_jerk
from fakes.world.layout import Layout
from fakes.world.poses import WORK_ROTATION, retracted_pose
from fakes.world.world import World
from vgrd.geometry import Array, Pose, exp_rotation

SEED = 1
REMEMBERED_S = 30.0
TURN_RAD_S = 1.0
STILL = Pose.identity()
NEAR_MM = 40.0  # above a target: the arm hides tag B on its last way


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """How the object stands on its table from `since_s` on, until the next one.

    offset: from where the table alone would have it, in the table's frame, as its motion allows it; lift: what
    its motion does not allow, on top.
    """

    since_s: float
    offset: Pose
    lift: Pose
    start_rad: float
    end_rad: float
    turn_s: float

    def angle(self, now_s: float) -> float:
        share = minimum_jerk(now_s - self.since_s, self.turn_s)
        return self.start_rad + share * (self.end_rad - self.start_rad)


class Plant:
    """One cell. Slips are in the frame of what slipped; `lens` scales what another camera sees."""

    def __init__(self) -> None:
        self.layout = Layout()
        self.world = World(self.layout, SEED, turn_rad_s=TURN_RAD_S)
        self.arm = self.world.arm
        self.arm.move_flange(retracted_pose(), 0.0)
        self.placements = deque([Placement(0.0, STILL, STILL, 0.0, 0.0, 0.0)])
        self.covered: set[str] = set()
        self.is_dark = False
        self.tag_a_slip = self.tag_b_slip = self.camera_shift = STILL
        self.lens = 1.0
        self.pendant_tcp = self.arm.wrist_from_tcp

    # What happens to it.

    def turn(self, angle_rad: float, now_s: float) -> None:
        """Start to turn the table, from wherever it is."""
        at = self.placements[-1]
        angle = at.angle(now_s)
        turn_s = PEAK_OVER_MEAN * abs(angle_rad - angle) / TURN_RAD_S
        self._place(Placement(now_s, at.offset, at.lift, angle, angle_rad, turn_s))

    def jerk(self, angle_rad: float, now_s: float, offset: Pose = STILL) -> None:
        """Put the object elsewhere in no time: the most sudden move that there is."""
        self._place(Placement(now_s, offset, STILL, angle_rad, angle_rad, 0.0))

    def lift(self, lift: Pose, now_s: float) -> None:
        """Take it off its motion, in no time."""
        at = self.placements[-1]
        angle = at.angle(now_s)
        self._place(Placement(now_s, at.offset, lift, angle, angle, 0.0))

    def repair(self, now_s: float) -> None:
        """Put everything back that is not as it was taught; the object stays where it may stand."""
        self.tag_a_slip = self.tag_b_slip = self.camera_shift = STILL
        self.lens, self.is_dark = 1.0, False
        self.covered.clear()
        self.arm.wrist_from_tcp = self.pendant_tcp
        self.arm.move_flange(retracted_pose(), now_s)
        at = self.placements[-1]
        self._place(Placement(now_s, at.offset, STILL, at.angle(now_s), at.angle(now_s), 0.0))

    def approach(self, target: str, now_s: float) -> None:
        """Move the arm near to where a target is now."""
        tip = self.point(target, now_s) - WORK_ROTATION @ self.layout.tcp_in_wrist
        self.arm.move_flange(Pose(WORK_ROTATION, tip + np.array([0, 0, NEAR_MM])), now_s)

    def wander(self, seed: int, now_s: float) -> None:
        """Move the arm somewhere around where it waits."""
        rng = np.random.default_rng(seed)
        aside = retracted_pose()
        turn = exp_rotation(rng.uniform(-0.2, 0.2, 3)) @ aside.rotation
        self.arm.move_flange(Pose(turn, aside.translation + rng.uniform(-40, 40, 3)), now_s)

    def _place(self, placement: Placement) -> None:
        self.placements.append(placement)
        while self.placements[1].since_s < placement.since_s - REMEMBERED_S:
            self.placements.popleft()

    # What is true.

    def base_from_object(self, now_s: float, *, lifted: bool = True) -> Pose:
        """Where the object is or was; lifted False: would be, were it not lifted."""
        at = next((p for p in reversed(self.placements) if p.since_s <= now_s), self.placements[0])
        turn = Pose.from_rotvec((0.0, 0.0, at.angle(now_s)))
        lift = at.lift if lifted else STILL
        return self.layout.base_from_table @ lift @ at.offset @ turn

    def point(self, target: str, now_s: float) -> Array:
        """Where a target is, (3,) base, mm."""
        return np.asarray(
            self.base_from_object(now_s) @ self.layout.targets[target].point_in_object
        )

    def tip(self, answered: Pose) -> Array:
        """Where the tool's tip comes to when the arm is sent to a flange pose, (3,) base, mm."""
        return np.asarray(self.arm.true_at(answered) @ self.layout.tcp_in_wrist)

    @property
    def base_from_camera(self) -> Pose:
        """Where the camera stands."""
        return self.layout.base_from_camera @ self.camera_shift

    def tag_in_camera(self, name: str, now_s: float, *, slipped: bool = True) -> Pose:
        """A tag as it stands to the camera; slipped False: as it would, were nothing wrong with it."""
        if name == "a":
            base_from_part, mounted = self.arm.true_flange(now_s), self.layout.wrist_from_tag_a
            slip = self.tag_a_slip
        else:
            base_from_part = self.base_from_object(now_s, lifted=slipped)
            mounted = self.layout.object_from_tag_b
            slip = self.tag_b_slip
        tag = base_from_part @ mounted @ (slip if slipped else STILL)
        return self.base_from_camera.inverse() @ tag

    @property
    def wrongs(self) -> tuple[str, ...]:
        """What is not as it was taught, in words."""
        return tuple(
            word
            for word, pose in (
                ("tag A slipped", self.tag_a_slip),
                ("tag B slipped", self.tag_b_slip),
                ("camera moved", self.camera_shift),
                ("object off its motion", self.placements[-1].lift),
            )
            if pose is not STILL
        ) + (("another lens",) if self.lens != 1.0 else ())
