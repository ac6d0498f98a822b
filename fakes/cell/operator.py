"""The scripted operator: jogs, touches with the paper's noise, turns the table, presses the buttons.

It uses the control API only, as a person with the command line would.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fakes.world.layout import FIXED_POINT
from fakes.world.poses import (
    WORK_ROTATION,
    fixed_point_poses,
    look_poses,
    retracted_pose,
    touch_tilts,
)
from fakes.world.world import World
from vgrd.errors import ControlError
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.ipc.control import ControlClient

SETTLE_S = 0.1  # twice what rest is asked for before a picture (`RestLimits.before_s`)
LIFT_MM = 30.0  # a guess: clear of the object before the arm turns, and soon done
SPEED_MM_S, TURN_RAD_S = 700.0, 3.0  # a brisk cell: nobody wants to wait for a simulated arm
PRESSES, PRESS_AGAIN_S = 20, 0.3  # some 6 s in all: a lost device serves again within 5 s
REPLY_TIMEOUT_S = 60.0  # a sample needs two pictures; on a busy machine each may take seconds
# The daemon asks to wait and try again; nothing has happened yet.
PASSING = ("NotSteady", "TooOld", "DeviceUnavailable")
Step = Callable[[], None]


class Operator:
    """Teaches a cell; `sightings` counts in how many samples of each kind each tag was in view.

    `repeats` counts the buttons that were pressed again because the daemon asked to wait.
    """

    def __init__(self, world: World, control: ControlClient, seed: int) -> None:
        self.world = world
        self.control = control
        self.seed = seed
        self.sightings: Counter[tuple[str, str]] = Counter()
        self.taught: Counter[str] = Counter()
        self.repeats = 0

    def press(self, op: str, **arguments: object) -> dict[str, Any]:
        """Give a command and return its result; pressed again where the daemon asks to wait."""
        for _ in range(PRESSES - 1):
            try:
                return dict(self.control.call(op, timeout_s=REPLY_TIMEOUT_S, **arguments))
            except ControlError as refusal:
                if refusal.error not in PASSING:
                    raise
                self.repeats += 1
                time.sleep(PRESS_AGAIN_S)
        return dict(self.control.call(op, timeout_s=REPLY_TIMEOUT_S, **arguments))

    def looks(self, count: int) -> list[Step]:
        """Hand-eye samples from varied wrists."""
        poses = look_poses(self.world.layout, count, seed=self.seed)
        return [self._at(pose, "look") for pose in poses]

    def spins(self, count: int) -> list[Step]:
        """The object turned by equal angles, arm aside; ends where it began."""
        angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
        return [self._spin(float(angle)) for angle in angles]

    def touches(self, targets: Sequence[str], tilted: bool) -> list[Step]:
        """Touch targets with the work orientation, or each with a tilted wrist."""
        names = list(targets)
        tilts = touch_tilts(self.world.layout, names, seed=self.seed) if tilted else []
        rotations = [exp_rotation(tilt) @ WORK_ROTATION for tilt in tilts]
        rotations = rotations or [WORK_ROTATION] * len(names)
        return [
            self._touch(name, rotation, "touch", target=name)
            for name, rotation in zip(names, rotations, strict=True)
        ]

    def points(self, count: int) -> list[Step]:
        """Touches of the fixed point beside the table, wrists varied (conventional TCP)."""
        poses = fixed_point_poses(self.world.layout, count, seed=self.seed)
        return [
            self._touch(FIXED_POINT, pose.rotation, "point", name=FIXED_POINT) for pose in poses
        ]

    def jog(self, base_from_wrist: Pose) -> None:
        """Jog the flange somewhere and let it settle."""
        self._wait(self.world.move_flange(base_from_wrist, time.monotonic()))

    def turn(self, angle_rad: float) -> None:
        """Turn the table and let it settle."""
        self._wait(self.world.turn_table(angle_rad, time.monotonic()))

    def _at(self, pose: Pose, op: str) -> Step:
        def step() -> None:
            self.jog(pose)
            self._sample(op)

        return step

    def _spin(self, angle_rad: float) -> Step:
        def step() -> None:
            arrival = self.world.move_flange(retracted_pose(self.world.layout), time.monotonic())
            self._wait(max(arrival, self.world.turn_table(angle_rad, time.monotonic())))
            self._sample("spin")

        return step

    def _touch(self, place: str, rotation: Array, op: str, **arguments: str) -> Step:
        def step() -> None:
            self.turn(0.0)
            self._wait(self.world.jog_onto(place, rotation, time.monotonic()))
            self._sample(op, **arguments)
            self._lift()

        return step

    def _lift(self) -> None:
        pose = self.world.reported_flange(time.monotonic())
        away = -LIFT_MM * (pose.rotation @ self.world.layout.tool_axis_in_wrist)
        self.jog(Pose(pose.rotation, pose.translation + away))

    def _sample(self, op: str, **arguments: str) -> None:
        reply = self.press(op, **arguments)
        self.taught[op] += 1
        for tag in reply["tags"]:
            self.sightings[op, tag] += 1

    @staticmethod
    def _wait(arrival_s: float) -> None:
        time.sleep(max(0.0, arrival_s - time.monotonic()) + SETTLE_S)
