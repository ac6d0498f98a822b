"""Runs config/robot_programs/python/vgrd_robot.py in a world, poll by poll."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from tests.robot_programs.world import (
    BOX_MM,
    TAUGHT,
    Outcome,
    World,
    approach_of,
    pose_of,
)
from vgrd.geometry import Pose

FILE = Path(__file__).parents[2] / "config" / "robot_programs" / "python" / "vgrd_robot.py"


def module_of(source: str) -> ModuleType:
    """The client as a module of its own; mutations are run like this."""
    spec = importlib.util.spec_from_loader("vgrd_robot", loader=None)
    module = importlib.util.module_from_spec(spec)
    sys.modules["vgrd_robot"] = module  # its dataclasses look for it
    exec(compile(source, FILE.name, "exec"), module.__dict__)  # noqa: S102
    return module


def flat(pose: Pose) -> tuple[float, ...]:
    """Position and rotation vector."""
    return (*map(float, pose.translation), *map(float, pose.rotvec()))


class GivenArm:
    """The arm of the world, as the client wants it given."""

    def __init__(self, world: World):
        self._world, self._arm = world, world.arm

    def move_to(self, pose, speed_mm_s) -> None:
        self._arm.move(Pose.from_rotvec(pose[3:], pose[:3]), speed_mm_s)

    def moving(self) -> bool:
        return self._arm.moving

    def stop(self) -> None:
        self._arm.stop()

    def flange_pose(self) -> tuple[float, ...]:
        return flat(self._arm.flange)

    def reachable(self, pose) -> bool:
        coordinate = self._world.cell.standing_coordinate
        places = {"coordinate": pose_of(coordinate), "approach": approach_of(coordinate)}
        barred = [places[what].translation for what in self._arm.out_of_reach]
        return all(abs(place - pose[:3]).max() > 1e-3 for place in barred)


class PythonRun:
    """The client in a world; `until_rest` and `press_key` tell what came of it."""

    poll_s = 0.05

    def __init__(self, world: World, module: ModuleType):
        self.world, self._module = world, module

        class Link(module.ModbusLink):  # type: ignore[name-defined]  # known when it runs
            """Frames go by memory, in no time."""

            def open(self) -> None:
                self.read()

            def exchange(self, request: bytes) -> bytes:
                answer = world.cell.exchange(request)
                if answer is None or answer[0] != request[0]:
                    raise module.LinkLost("no answer")
                return answer

        low, high = (tuple(TAUGHT.translation + way) for way in (-BOX_MM, BOX_MM))
        self.program = module.Program(
            GivenArm(world),
            Link(module.Address(), 0.2),
            taught=module.Taught(flat(TAUGHT)),
            limits=module.Limits(box_low=low, box_high=high),
            clock=world.clock.monotonic,
            trig=world.first_trig,
        )

    def start(self) -> Outcome:
        """Run until it rests."""
        self.program.start()
        return self._until_rest()

    def wait(self, seconds: float) -> None:
        """Nobody presses the key."""
        end_s = self.world.clock.monotonic() + seconds
        while self.world.clock.monotonic() < end_s:
            self._step()

    def press_key(self) -> Outcome:
        """The operator's one key."""
        self.program.resume()
        return self._until_rest()

    def close(self) -> None:
        """Nothing is left."""

    def _step(self) -> None:
        self.program.step()
        self.world.advance(self.poll_s)

    def _until_rest(self) -> Outcome:
        State = self._module.State
        while self.program.state not in (State.DONE, State.STOPPED):
            if self.program.state is State.AT_POINT:
                self.program.leave()
            self._step()
        return self.world.outcome(self.program.word, self.program.status)
