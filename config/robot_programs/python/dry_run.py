"""A dry run of `vgrd_robot`: asks the daemon and moves an arm that is only numbers.

    make cell                                 # in the project: a simulated cell on port 1502
    python3 config/robot_programs/python/dry_run.py --point 1

Without --taught it asks once more before: where the point is now stands for where it was taught.
A real program never does that: its taught pose is what it judges answers by.
"""

import argparse
import math
import sys
import time
from collections.abc import Sequence

from vgrd_robot import (
    RESTING,
    Address,
    Limits,
    ModbusLink,
    Pose,
    Program,
    Request,
    State,
    Taught,
    distance_mm,
)


class DryArm:
    """Flies straight to where it is sent, in numbers; reaches everything."""

    def __init__(self, pose: Pose) -> None:
        self._from = self._to = pose
        self._start_s = self._end_s = 0.0

    def move_to(self, pose: Pose, speed_mm_s: float) -> None:
        """Start a straight move."""
        self._from, self._to = self.flange_pose(), pose
        self._start_s = time.monotonic()
        self._end_s = self._start_s + distance_mm(self._from, pose) / speed_mm_s
        print(f"move to {_words(pose)} at {speed_mm_s:g} mm/s")

    def moving(self) -> bool:
        """Whether it is on its way."""
        return time.monotonic() < self._end_s

    def stop(self) -> None:
        """Stand where it is."""
        self._from = self._to = self.flange_pose()
        self._end_s = 0.0
        print(f"stop at {_words(self._to)}")

    def flange_pose(self) -> Pose:
        """Between start and end as the time is."""
        if not self.moving():
            return self._to
        part = (time.monotonic() - self._start_s) / (self._end_s - self._start_s)
        x, y, z = (a + part * (b - a) for a, b in zip(self._from[:3], self._to[:3], strict=True))
        return (x, y, z, *self._to[3:])

    def reachable(self, pose: Pose) -> bool:  # noqa: ARG002
        """It has no joints."""
        return True


class AskingArm(DryArm):
    """Reaches nothing, and keeps where it was to go: the program stops before it moves."""

    def __init__(self, pose: Pose) -> None:
        super().__init__(pose)
        self.asked: list[Pose] = []

    def reachable(self, pose: Pose) -> bool:
        """Never."""
        self.asked.append(pose)
        return False


def _words(pose: Pose) -> str:
    x, y, z, rx, ry, rz = pose
    return f"{x:.3f} {y:.3f} {z:.3f} mm, {rx:.4f} {ry:.4f} {rz:.4f} rad"


def _run(program: Program, arm: DryArm) -> State:
    """Poll until the program rests; tell each new state, and why it stops."""
    state = None
    while program.state not in RESTING or state is None:
        if program.state is not state:
            state = program.state
            print(state.value)
        program.step()
        time.sleep(program.limits.poll_s)
    if not isinstance(arm, AskingArm) or not arm.asked:
        print(_report(program))
    return program.state


def _report(program: Program) -> str:
    """Its last word, and what helps where nobody answers."""
    if program.word == "LINK":
        return f"{program.report}: does the daemon run (make cell), are --host and --port right?"
    return program.report or program.state.value


def main() -> int:
    """Go to a point and back."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=_number_16, default=1502)
    parser.add_argument("--point", type=_number_16, default=1)
    parser.add_argument(
        "--taught", type=float, nargs=6, help="x y z (mm) rx ry rz (rad) of the flange"
    )
    given = parser.parse_args()
    link = ModbusLink(Address(given.host, given.port), Limits().link_s)
    pose = _pose(given.taught) if given.taught else _found(link, given.point)
    if pose is None:
        return 1
    x, y, z, rx, ry, rz = pose
    limits = Limits(box_low=(x - 100, y - 100, z - 100), box_high=(x + 100, y + 100, z + 100))
    start = (x, y, z + 150, rx, ry, rz)
    arm = DryArm(start)
    program = Program(arm, link, Request(given.point), Taught(pose), limits)
    program.start()
    if _run(program, arm) is State.AT_POINT:
        program.leave()
        _run(program, arm)
    return 0 if program.state is State.DONE else 1


def _number_16(text: str) -> int:
    """A port, or what fits a register; argparse tells the error."""
    number = int(text)
    if not 1 <= number <= 0xFFFF:
        raise argparse.ArgumentTypeError(f"{text}: 1 to 65535")
    return number


def _pose(numbers: Sequence[float]) -> Pose:
    x, y, z, rx, ry, rz = numbers
    return (x, y, z, rx, ry, rz)


def _found(link: ModbusLink, point: int) -> Pose | None:
    """Where the point is now; None, and why, where nobody tells."""
    anywhere = (math.inf,) * 3
    limits = Limits(
        box_low=(-math.inf,) * 3, box_high=anywhere, step_mm=math.inf, step_deg=math.inf
    )
    arm = AskingArm(Taught().pose)
    program = Program(arm, link, Request(point), Taught(), limits)
    program.start()
    _run(program, arm)
    link.close()
    if not arm.asked:
        return None
    print(f"the point is at {_words(arm.asked[0])}: taken for the taught pose")
    return arm.asked[0]


if __name__ == "__main__":
    sys.exit(main())
