"""Rules: what happens to devices, processes, clocks and the cell file."""

from tests.invariant.rig import Rig
from tests.invariant.rules.table import SEEDS, Among, rule

PROCESSES = Among(("cell", "camera", "robot"))


@rule("F1 C2", weight=2)
def camera_unplugged(rig: Rig) -> None:
    rig.unplug("camera")


@rule("F13 F14", weight=2)
def robot_unplugged(rig: Rig) -> None:
    rig.unplug("robot")


@rule(weight=3)
def plugged_in(rig: Rig) -> None:
    rig.plug_in()


@rule(
    "F2 F5 F6 F7 F8",
    fault=Among(("repeat", "freeze", "noise", "shape", "ahead", "drop", "hang")),
)
def camera_fault(rig: Rig, fault: str) -> None:
    rig.daemon.camera.fault = fault


@rule("F14 F16 F17 F18", fault=Among(("nan", "jump", "far", "ahead", "old")))
def robot_fault(rig: Rig, fault: str) -> None:
    rig.daemon.robot.fault = fault


@rule("F15 R1", reading_s=Among((0.008, 0.04, 0.1, 0.2, 0.5)))
def robot_rate(rig: Rig, reading_s: float) -> None:
    """From 125 readings a second to fewer than are taken."""
    rig.daemon.robot.reading_s = reading_s


@rule("F7 F19", seed=SEEDS)
def robot_tells_an_old_pose(rig: Rig, seed: int) -> None:
    """Its time goes on, its pose does not, and the arm moves."""
    rig.daemon.robot.frozen = rig.plant.arm.reported_flange(rig.clock.now_s)
    rig.plant.wander(seed, rig.clock.now_s)


@rule()
def safety_stop(rig: Rig) -> None:
    rig.daemon.robot.is_running = not rig.daemon.robot.is_running


@rule()
def regions(rig: Rig) -> None:
    """Another mode of the camera: regions or whole pictures."""
    rig.daemon.camera.sends_regions = not rig.daemon.camera.sends_regions
    rig.judge.slower(0.0)


@rule("F4 F30 F34 R7 C12", weight=2, name=PROCESSES)
def killed(rig: Rig, name: str) -> None:
    rig.kill(name)


@rule("F40 C16", weight=0.3)
def gate_killed(rig: Rig) -> None:
    """And with it all the others; systemd starts it anew."""
    rig.kill("gate")


@rule("F3 F29 C2", weight=2, name=PROCESSES, seconds=Among((0.1, 0.24, 0.5, 3.0)))
def stopped(rig: Rig, name: str, seconds: float) -> None:
    """A process that gets no time, or hangs in a library that holds the GIL."""
    rig.stop(name)
    rig.wait(seconds)
    rig.go_on(name)


@rule("F29", weight=0.5, seconds=Among((0.05, 0.1, 0.3, 0.6)))
def gate_stopped(rig: Rig, seconds: float) -> None:
    """What robots read then is what comes at the end of it."""
    rig.stop("gate")
    rig.wait(seconds)
    rig.go_on("gate")


@rule("F29", weight=0.5, seconds=Among((0.2, 0.6, 2.5)))
def busy(rig: Rig, seconds: float) -> None:
    """The machine has more to do than it can: pictures are evaluated late, until somebody repairs it."""
    rig.slow_down(seconds)


@rule("F27", hours=Among((-1.0, 1.0)))
def wall_clock_stepped(rig: Rig, hours: float) -> None:
    rig.clock.step_wall(3600 * hours)


@rule("F28", seconds=Among((0.1, 0.3, 10.0, 4000.0)), turned_rad=Among((0.0, 0.35)))
def suspended(rig: Rig, seconds: float, turned_rad: float) -> None:
    """Nothing runs for a while, and the world goes on."""
    rig.suspend(seconds, turned_rad)


@rule("C7", weight=0.3, dies=Among((False, True)))
def registers_deleted(rig: Rig, dies: bool) -> None:
    """Somebody tidies up the runtime folder, and the cell dies or goes on."""
    (rig.daemon.runtime / "registers.ring").unlink(missing_ok=True)
    if dies:
        rig.kill("cell")


@rule("F35 F48 C5 C14 S3", weight=1.5, which=Among((0, 1, 2, 3)))
def activated(rig: Rig, which: int) -> None:
    """One of two that are right, one that was rejected, one of another cell."""
    rig.activate(rig.daemon.names[which])


@rule("F38 F39 C6 S3", weight=0.5, seconds=Among((0.5, 1.5, 3.0)), scale=Among(("mrad", "fine")))
def reloaded(rig: Rig, seconds: float, scale: str) -> None:
    """`vgrd reload` of a cell file with another greatest age and another unit."""
    rig.reload(seconds, scale)


# The walk goes on long after a rule: a narrow workspace would leave it little that is valid to judge.
@rule(weight=0.0, outer_radius_mm=Among((450.0, 480.0)))
def workspace_reloaded(rig: Rig, outer_radius_mm: float) -> None:
    """`vgrd reload` of a cell file with a workspace that holds a part of the table."""
    rig.reload(3.0, "mrad", outer_radius_mm)
