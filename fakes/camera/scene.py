"""What a fake camera sees: pictures of the world's newest snapshot, which travels through a ring."""

import time
from collections.abc import Callable
from pathlib import Path

from fakes.camera.render import Renderer
from fakes.camera.sensor import Picture, PixelRegion
from fakes.world.layout import Layout
from fakes.world.world import World, WorldSnapshot
from vgrd.clock import SystemClock
from vgrd.errors import IpcError
from vgrd.ipc.ring import RingReader, RingWriter

KIND = "snapshot"
_SLOTS, _SLOT_BYTES = 8, 4096  # a snapshot has up to 400 bytes; readers want the newest
_WAIT_S = 0.5  # 25 of the snapshots that come at least every 20 ms


class SnapshotWriter:
    """The world's side: publish a snapshot at least every 20 ms."""

    def __init__(self, path: Path) -> None:
        self._ring = RingWriter.create(path, _SLOTS, _SLOT_BYTES, KIND)

    def publish(self, snapshot: WorldSnapshot, now_s: float) -> None:
        """Show `snapshot` to the cameras; `now_s`: monotonic clock at which it was true."""
        self._ring.publish(snapshot.to_json().encode(), stamp_s=now_s)

    def close(self) -> None:
        """Release the ring."""
        self._ring.close()


Draw = Callable[[PixelRegion | None], Picture]


def pictures(snapshots: Path | None, layout: Layout | None = None) -> Draw:
    """Return a function that draws what is seen after its call, whole or a region of it.

    snapshots: ring of a `SnapshotWriter`; None: a world of its own in which nothing moves.
    Raises RingUnavailable where there is no such ring; the function raises TimeoutError when the
    world has stopped publishing.
    """
    layout = layout or Layout()
    renderer = Renderer(layout)
    if snapshots is None:
        world = World(layout, seed=0)
        return lambda region: renderer.render(world.snapshot(time.monotonic()), region)
    reader, clock = RingReader.open(snapshots, KIND), SystemClock()

    def draw(region: PixelRegion | None) -> Picture:
        asked_s = clock.monotonic()
        while True:
            try:
                message = reader.wait_newer(reader.index, _WAIT_S, clock)
            except IpcError as error:
                raise TimeoutError(str(error)) from error
            if message is None:
                raise TimeoutError(f"{snapshots}: the world has stopped")
            # On a busy machine a snapshot of before may be published after.
            if message.stamp_s >= asked_s:
                return renderer.render(WorldSnapshot.from_json(message.payload), region)

    return draw
