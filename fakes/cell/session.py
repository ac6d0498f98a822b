"""A short working life of a daemon: teach, solve, activate, serve, and every process killed once."""

import time

from fakes.cell.daemon import Daemon
from fakes.cell.operator import Operator
from fakes.controllers.robot_program import Reply, RobotProgram, Stopped
from fakes.world.poses import retracted_pose
from fakes.world.world import World

BACK_S = 60.0  # a killed process is back in seconds, on a busy machine much later
MISS_MM = 1.0  # as `max_u95_mm`: a short session is coarse, a wrong one is far off


def teach(operator: Operator, world: World) -> None:
    """As few samples as give a calibration that is accepted."""
    names = list(world.targets)
    operator.press("record.start", plan="joint", session="short")
    steps = [*operator.looks(6), *operator.spins(5), *operator.touches(names, tilted=False)]
    for step in [*steps, *operator.touches(names[:4], tilted=True)]:
        step()
    operator.press("record.stop")


def ask_until_answered(program: RobotProgram, point: int) -> Reply:
    """Ask until all is back; what the program stopped for last when it is not in time."""
    end = time.monotonic() + BACK_S
    while time.monotonic() < end:
        try:
            return program.ask(point)
        except Stopped:
            time.sleep(0.2)
    return program.ask(point)


def check_served(world: World, host: str, port: int) -> None:
    """A robot asks for a target and gets where it truly is. Raises ValueError."""
    with RobotProgram(world, host, port) as program:
        reply = ask_until_answered(program, 1)
    target = next(name for name, target in world.targets.items() if target.id == 1)
    miss = world.miss_at(reply.base_from_wrist, target, world.table_angle(time.monotonic()))
    if float((miss @ miss) ** 0.5) > MISS_MM:
        raise ValueError(f"served {miss} mm beside {target}")


def calibrate(world: World, daemon: Daemon) -> None:
    """Teach, solve, activate, arm aside. Raises what the daemon refuses with, ValueError."""
    operator = Operator(world, daemon.control, world.seed)
    teach(operator, world)
    solved = daemon.control.call("solve", timeout_s=120.0)
    if solved["calibration"] is None:
        raise ValueError(f"no calibration was accepted: {solved['verdict']}")
    operator.press("activate", calibration=solved["calibration"], by="test")
    operator.jog(retracted_pose(world.layout))


def work(world: World, daemon: Daemon, host: str, port: int) -> None:
    """The whole of it. Raises what the daemon refuses with, ValueError, TimeoutError."""
    calibrate(world, daemon)
    check_served(world, host, port)
    for process in ("cell", "robot", "camera"):
        victim = daemon.pid_of(process)
        daemon.kill(process)
        daemon.wait_reborn(process, victim)
        check_served(world, host, port)
