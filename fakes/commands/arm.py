"""The arm of a fake controller that runs without a world."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from fakes.commands.console import Action, numbers
from fakes.controllers.rtde import RtdeState
from vgrd.geometry import Pose

_PERIOD_S = 10.0  # of a circle: slow enough to watch by eye


@dataclass(slots=True)
class ScriptedArm:
    """A flange that stands still, or circles horizontally with `radius_mm` in ten seconds."""

    radius_mm: float = 0.0
    base_from_wrist: Pose = field(  # in front of the foot, tool down
        default_factory=lambda: Pose.from_rotvec((0.0, math.pi, 0.0), (400.0, -100.0, 350.0))
    )
    wrist_from_tcp: Pose = field(  # of an ordinary tool, turned and off the axis
        default_factory=lambda: Pose.from_rotvec((0.0, 0.0, 0.4), (12.0, -3.0, 152.0))
    )
    digital_inputs: int = 0

    def state(self, now_s: float) -> RtdeState:
        """State at a time of the monotonic clock."""
        if not self.radius_mm:
            return RtdeState(
                self.base_from_wrist, self.wrist_from_tcp, digital_inputs=self.digital_inputs
            )
        rate = 2.0 * math.pi / _PERIOD_S
        sine, cosine = math.sin(rate * now_s), math.cos(rate * now_s)
        shift = self.radius_mm * np.array((cosine, sine, 0.0))
        wrist = self.base_from_wrist
        return RtdeState(
            Pose(wrist.rotation, wrist.translation + shift),
            self.wrist_from_tcp,
            (-self.radius_mm * rate * sine, self.radius_mm * rate * cosine, 0.0, 0.0, 0.0, 0.0),
            self.digital_inputs,
        )

    def place(self, words: list[float]) -> None:
        """Put the flange at x y z (mm) and rotation vector (rad) in the base."""
        self.base_from_wrist = Pose.from_rotvec(words[3:], words[:3])

    def mount(self, words: list[float]) -> None:
        """Make another TCP active: x y z (mm) and rotation vector (rad) in the flange."""
        self.wrist_from_tcp = Pose.from_rotvec(words[3:], words[:3])

    def actions(self) -> dict[str, Action]:
        """Lines that change the arm; `reset` undoes them."""
        start = replace(self)

        def reset(_: Sequence[str]) -> None:
            for item in fields(self):
                setattr(self, item.name, getattr(start, item.name))

        return {
            "reset": reset,
            "pose X Y Z RX RY RZ": lambda words: self.place(numbers(words, 6)),
            "tcp X Y Z RX RY RZ": lambda words: self.mount(numbers(words, 6)),
            "circle RADIUS": lambda words: setattr(self, "radius_mm", numbers(words, 1)[0]),
            "inputs NUMBER": lambda words: setattr(
                self, "digital_inputs", int(numbers(words, 1)[0])
            ),
        }
