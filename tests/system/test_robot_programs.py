"""The Python client on the running cell: over real Modbus, with the fake cell's arm, to the true target."""

import subprocess
import sys
import time

import numpy as np
import pytest

from fakes.world.poses import retracted_pose
from fakes.world.world import World
from tests.robot_programs.python_run import FILE, flat, module_of
from vgrd.geometry import Pose

pytestmark = pytest.mark.system

CLIENT = module_of(FILE.read_text())
PATIENCE_S = (
    120.0  # a busy machine takes its time; what the limits are for is tried in stepped time
)
FAR = 1e4  # mm or degrees: the cell's table turns everywhere, nothing was taught to this program
POINT = "P1"
TRIES = 5  # on a busy machine an answer may end under way


class WorldArm:
    """The fake cell's arm, as a client wants it given."""

    def __init__(self, world: World):
        self._world = world
        self._arrival_s = 0.0

    def move_to(self, pose, speed_mm_s) -> None:
        base_from_wrist = Pose.from_rotvec(pose[3:], pose[:3])
        tcp = base_from_wrist.compose(self._world.arm.wrist_from_tcp)
        self._arrival_s = self._world.move_tcp(tcp, time.monotonic())

    def moving(self) -> bool:
        return time.monotonic() < self._arrival_s

    def stop(self) -> None:
        now_s = time.monotonic()
        self._arrival_s = self._world.move_flange(self._world.reported_flange(now_s), now_s)

    def flange_pose(self) -> tuple[float, ...]:
        return flat(self._world.reported_flange(time.monotonic()))

    def reachable(self, pose) -> bool:
        return True


@pytest.fixture
def program(live):
    world = live.cell.world
    live.cell.operator(live.daemon).jog(retracted_pose())
    live.daemon.wait_until(lambda status: bool(status["serving"]))
    limits = CLIENT.Limits(
        link_s=PATIENCE_S,
        heartbeat_s=PATIENCE_S,
        answer_s=PATIENCE_S,
        age_ms=0xFFFE,
        step_mm=FAR,
        step_deg=FAR,
        box_low=(-FAR,) * 3,
        box_high=(FAR,) * 3,
        attempts=100,
    )
    link = CLIENT.ModbusLink(CLIENT.Address("127.0.0.1", live.cell.port), PATIENCE_S)
    request = CLIENT.Request(point=1, degraded_allowed=True)
    taught = CLIENT.Taught(tool_z=tuple(map(float, world.layout.tool_axis_in_wrist)))
    yield CLIENT.Program(WorldArm(world), link, request, taught, limits)
    link.close()


def run(program, until) -> None:
    """Step until a state; a busy machine may end an answer under way, then somebody presses the key."""
    end_s = time.monotonic() + PATIENCE_S
    while program.state is not until:
        assert time.monotonic() < end_s, f"{program.state}: {program.report}"
        program.step()
        program.resume()
        time.sleep(program.limits.poll_s)


def test_the_client_takes_the_tip_to_the_target_and_back(live, program):
    world = live.cell.world
    program.start()
    run(program, CLIENT.State.AT_POINT)
    assert np.linalg.norm(world.miss(POINT, time.monotonic())) < 1.0
    program.leave()
    run(program, CLIENT.State.DONE)
    assert np.linalg.norm(world.miss(POINT, time.monotonic())) > 40.0


def test_the_dry_run_of_a_newcomer_reads_a_valid_coordinate_and_goes_there(live, program):
    """By the README: no argument but the port of the cell."""
    del program  # it has brought the arm out of the view
    words = [sys.executable, "-S", "-E", str(FILE.with_name("dry_run.py"))]
    for _ in range(TRIES):
        ran = subprocess.run(
            [*words, "--port", str(live.cell.port)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        if ran.returncode == 0:
            break
    assert ran.returncode == 0, ran.stdout + ran.stderr
    served = live.daemon.control.call("ec", target=POINT)["position_mm"]
    found = next(line for line in ran.stdout.splitlines() if line.startswith("the point is at "))
    assert [float(word) for word in found.split()[4:7]] == pytest.approx(served, abs=0.2)
    assert ran.stdout.splitlines()[-1] == "done"
