"""A whole fake cell on the wire: one world, a controller, a camera, and the cell file that describes them."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from fakes.camera.cameras import Choice, choose
from fakes.camera.gige_camera import PORT as CAMERA_PORT
from fakes.camera.scene import SnapshotWriter
from fakes.cell.robot_link import Driver, RobotLink
from fakes.controllers.rtde import RtdeServer, RtdeState
from fakes.testing import FakeProcess, free_loopback
from fakes.world.cells import CELLS, DEFAULT, CellKind
from fakes.world.layout import Layout
from fakes.world.world import World
from vgrd.model import Motion

CAMERA_PACKET_BYTES = 16000  # loopback carries them; fewer than jumbo frames (9000) make
SNAPSHOT_RING = "world.ring"
SNAPSHOT_PERIOD_S = 0.004  # two cycles of the controller; pictures wait for the next one
START_TIMEOUT_S = (
    60.0  # of a thread; takes milliseconds unless the machine has far more to do than it can
)


class FakeCell:
    """Starts on `with`: controller and camera answer, `folder/cell.toml` tells the daemon where.

    camera: a driver, None for what this machine has. kind: what `world` is a world of. robot: None for a
    link as `kind` says. page: port of the operator's page, None for none. `digital_inputs`
    of the controller may be set at any time.
    """

    def __init__(
        self,
        world: World,
        folder: Path,
        port: int,
        camera: str | None = None,
        kind: CellKind = CELLS[DEFAULT],
        robot: RobotLink | None = None,
        page: int | None = None,
    ) -> None:
        self.page = page
        self.world = world
        self.folder = folder
        self.port = port
        self.kind = kind
        self.robot = robot or RobotLink.free(kind.controller)
        self.digital_inputs = 0
        self.camera, self.camera_reason = Choice(camera, "as asked for") if camera else choose()
        self.cell_file = folder / "cell.toml"
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name="controller", daemon=True)
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._error: BaseException | None = None
        self._resources = contextlib.ExitStack()
        self._camera: FakeProcess | None = None
        self._unplugged = False
        self._controller: object = None

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as undo:
            undo.callback(self._loop.close)
            self._snapshots = SnapshotWriter(self.folder / SNAPSHOT_RING)
            undo.callback(self._snapshots.close)
            undo.callback(self._end_controller)  # before the ring closes, which it writes
            self._publish()
            self._thread.start()
            if not self._ready.wait(START_TIMEOUT_S):
                raise TimeoutError(f"the controller did not start within {START_TIMEOUT_S:.0f} s")
            if self._error is not None:
                raise self._error
            camera = self._start_camera(undo)
            robot = self.robot.driver(self.world.arm.wrist_from_tcp)
            text = cell_text(self.world.layout, robot=robot, camera=camera, port=self.port)
            text += "" if self.page is None else f"[page]\nport = {self.page}\n"
            self.cell_file.write_text(text, encoding="utf-8")
            self._resources = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def disturb(self, act: Callable[[RtdeServer], None]) -> None:
        """Let `act` do something to the RTDE controller (faults, drop), in its own loop; wait until it is done."""

        async def perform() -> None:
            if isinstance(self._controller, RtdeServer):
                act(self._controller)

        asyncio.run_coroutine_threadsafe(perform(), self._loop).result(START_TIMEOUT_S)

    def unplug_camera(self) -> None:
        """Take the camera off the network; LookupError where it is no process of its own."""
        if self._camera is None:
            raise LookupError(f"{self.camera} runs inside the daemon and cannot be unplugged")
        self._camera.kill()
        self._unplugged = True

    def plug_camera(self) -> None:
        """Put an unplugged camera back, at the same address."""
        if self._camera is not None and self._unplugged:
            self._camera = self._resources.enter_context(self._camera.again())
            self._unplugged = False

    def tell_camera(self, line: str) -> None:
        """Type a line at the camera: a fault to switch on or off. LookupError as `unplug_camera`."""
        if self._camera is None:
            raise LookupError(f"{self.camera} runs inside the daemon and cannot be told anything")
        self._camera.type(line)

    def _start_camera(self, undo: contextlib.ExitStack) -> Driver:
        """Start the camera where it is a process of its own; returns what the cell file says of it."""
        ring = str((self.folder / SNAPSHOT_RING).resolve())
        if self.camera != "aravis":
            return Driver(self.camera, {"snapshots": ring, "cell": self.kind.name})
        host = free_loopback(CAMERA_PORT)
        of_world = ("--snapshots", ring, "--cell", self.kind.name)
        self._camera = undo.enter_context(FakeProcess("camera", "--host", host, *of_world))
        return Driver(self.camera, {"address": host, "packet_bytes": CAMERA_PACKET_BYTES})

    def _end_controller(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(START_TIMEOUT_S)

    def _serve(self) -> None:
        try:
            self._loop.run_until_complete(self._run())
        except OSError as err:
            self._error = err
            self._ready.set()

    async def _run(self) -> None:
        async with self.robot.controller(self._controller_state) as self._controller:
            self._ready.set()
            while not self._stop.is_set():
                self._publish()
                await asyncio.sleep(SNAPSHOT_PERIOD_S)

    def _controller_state(self, now_s: float) -> RtdeState:
        arm = self.world.arm
        return RtdeState(
            self.world.reported_flange(now_s),
            arm.wrist_from_tcp,
            digital_inputs=self.digital_inputs,
        )

    def _publish(self) -> None:
        now = time.monotonic()
        self._snapshots.publish(self.world.snapshot(now), now)


def cell_text(layout: Layout, *, robot: Driver, camera: Driver, port: int) -> str:
    """The cell file of a fake cell."""
    optics = layout.optics
    fx, fy = optics.matrix[0, 0], optics.matrix[1, 1]
    cx, cy = optics.matrix[0, 2], optics.matrix[1, 2]
    robot_settings, camera_settings = (
        "\n".join(f"{key} = {value!r}" for key, value in driver.settings.items())
        for driver in (robot, camera)
    )
    targets = "\n".join(
        f'[[object.targets]]\nid = {t.id}\nname = "{t.name}"\n'
        f"point_mm = {t.cad.tolist()}\nhole_diameter_mm = {t.hole_diameter_mm}\n"
        + ("" if t.clearance_mm is None else f"clearance_mm = {t.clearance_mm:.3g}\n")
        for t in layout.targets.values()
    )
    center = (
        "center_mm = [0.0, 0.0, 0.0]\ncenter_sigma_mm = 0.02\n"
        if layout.motion is Motion.TURNTABLE
        else ""
    )
    return f"""# The fake cell of `python -m fakes`; units are part of the keys.
[cell]
name = "fake-cell"
state_dir = "state"
runtime_dir = "run"
simulation = true

[robot]
driver = "{robot.name}"
id = "{robot.id}"
sigma_mm = 0.1
[robot.settings]
{robot_settings}

[camera]
driver = "{camera.name}"
id = "fake-camera"
rate_hz = 1.0
matrix = {[float(x) for x in (fx, fy, cx, cy)]}
distortion = {optics.distortion.tolist()}
size_px = {list(optics.size_px)}
[camera.settings]
{camera_settings}

[tags.a]
family = "{layout.tag_a.family}"
id = {layout.tag_a.id}
size_mm = {layout.tag_a.size_mm}
size_sigma_mm = 0.01  # a print that was measured under a microscope
[tags.b]
family = "{layout.tag_b.family}"
id = {layout.tag_b.id}
size_mm = {layout.tag_b.size_mm}
size_sigma_mm = 0.01

[tool]
name = "pin"
axis = {layout.tool_axis_in_wrist.tolist()}

[touch]
lateral_sigma_mm = 0.233
axial_sigma_mm = 0.233

[serving]
host = "127.0.0.1"
port = {port}
allow = ["127.0.0.1"]
policy = "fixed"
hidden_tag = "hold"

[object]
cad_sigma_mm = 0.0  # parts of the fake cell are as CAD has them
motion = "{layout.motion.value}"
{center}{targets}"""
