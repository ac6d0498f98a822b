"""The process around one driver: opens it, publishes into a ring, ends when the driver fails.

    python -m vgrd.devices.host robot|camera|pedal RUNTIME_DIR DRIVER SETTINGS_JSON

One connection per life of the process: the gate starts it again, by type of error (exit code).
"""

import importlib
import json
import logging
import sys
from pathlib import Path
from types import ModuleType

import structlog

from vgrd import logs
from vgrd.clock import Clock, SystemClock
from vgrd.devices import Camera, Pedal, Robot, Settings, wire
from vgrd.devices.catalogue import module_of, unknown_driver
from vgrd.devices.checks import FlangeCheck, FrameCheck
from vgrd.errors import (
    BadReading,
    ConfigError,
    DeviceRefused,
    DeviceUnavailable,
    InputError,
    RingUnavailable,
    VgrdError,
)
from vgrd.ipc.health import HealthReporter
from vgrd.ipc.ring import Message, RingReader, RingWriter

READ_TIMEOUT_S = 0.5  # chosen: two periods of the slowest robot (5 Hz), the second one late
GRAB_TIMEOUT_S = 2.0  # no request waits longer for its picture
PRESS_TIMEOUT_S = 0.5  # as of readings: the process shows that it lives
TRIGGER_POLL_S = 0.001  # chosen: delays a picture of 30 ms and more by less than a thirtieth
BAD_READINGS_IN_A_ROW = 50  # chosen: 0.4 s of a robot at 125 Hz, then its connection is made anew
BAD_PICTURES_IN_A_ROW = 5  # chosen: fewer than readings, since a slow picture takes a second

log = structlog.get_logger()


def driver_module(name: str) -> ModuleType:
    """The module of a driver: `ur_rtde` is `drivers.ur_rtde`, a dotted name is taken as it stands."""
    module = module_of(name)
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as err:
        if err.name != module:
            fault = f"{name} needs {err.name!r}, which is not installed: vgrd drivers {name}"
        else:
            fault = unknown_driver(name)
        raise ConfigError("driver", [fault]) from err


class BadReadings:
    """Counts bad readings; too many in a row mean that the device is of no use."""

    def __init__(self, limit: int = BAD_READINGS_IN_A_ROW) -> None:
        self.limit = limit
        self.in_a_row = 0

    def good(self) -> None:
        """A reading was usable."""
        self.in_a_row = 0

    def bad(self, error: BadReading) -> None:
        """A reading was not; raises DeviceUnavailable at the limit."""
        self.in_a_row += 1
        level = logging.WARNING if self.in_a_row == 1 else logging.DEBUG
        log.log(level, "bad_reading", reason=str(error))
        if self.in_a_row >= self.limit:
            raise DeviceUnavailable(
                f"{self.limit} bad readings in a row, the last: {error}"
            ) from error


def host_robot(robot: Robot, runtime_dir: Path, health: HealthReporter, clock: Clock) -> None:
    """Publish flange readings until the driver fails."""
    ring = RingWriter.create(
        runtime_dir / wire.FLANGE_RING,
        slots=wire.FLANGE_SLOTS,
        slot_bytes=wire.FLANGE_BYTES,
        kind=wire.FLANGE_KIND,
    )
    check, bad = FlangeCheck(clock), BadReadings()
    while True:
        try:
            reading = check.accept(robot.read_flange(READ_TIMEOUT_S))
        except BadReading as err:
            bad.bad(err)
        except InputError as err:  # a driver's numbers that are no pose
            bad.bad(BadReading(str(err)))
        else:
            bad.good()
            ring.publish(wire.pack_flange(reading), stamp_s=reading.stamp_s)
        health.progress("ok")


def host_camera(
    camera: Camera,
    runtime_dir: Path,
    health: HealthReporter,
    clock: Clock,
    picture_bytes: int,
) -> None:
    """Take one picture per trigger message until the driver fails."""
    ring = RingWriter.create(
        runtime_dir / wire.IMAGE_RING,
        slots=wire.IMAGE_SLOTS,
        slot_bytes=wire.IMAGE_HEADER_BYTES + picture_bytes,
        kind=wire.IMAGE_KIND,
        crc=False,
    )
    triggers = _Triggers(runtime_dir / wire.TRIGGER_RING)
    triggers.newest()  # from here on wishes count, before anybody hears that the camera is well
    check, bad = FrameCheck(picture_bytes), BadReadings(limit=BAD_PICTURES_IN_A_ROW)
    while True:
        health.progress("ok")
        wish = triggers.newest()
        if wish is None:
            clock.sleep(TRIGGER_POLL_S)
            continue
        try:
            region = wire.unpack_trigger(wish.payload)
            image = check.accept(camera.grab(GRAB_TIMEOUT_S, region))
        except BadReading as err:
            bad.bad(err)
            continue
        bad.good()
        ring.publish(wire.pack_image_header(image), image.pixels.data, stamp_s=image.stamp_s)


def host_pedal(pedal: Pedal, runtime_dir: Path, health: HealthReporter) -> None:
    """Publish presses until the driver fails."""
    ring = RingWriter.create(
        runtime_dir / wire.PEDAL_RING,
        slots=wire.PEDAL_SLOTS,
        slot_bytes=wire.PEDAL_BYTES,
        kind=wire.PEDAL_KIND,
    )
    while True:
        stamp_s = pedal.wait_press(PRESS_TIMEOUT_S)
        if stamp_s is not None:
            ring.publish(stamp_s=stamp_s)
        health.progress("ok")


class _Triggers:
    """The cell's wish for a picture: a counter in a ring, of which only the newest counts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ring: RingReader | None = None
        self.last_index = 0

    def newest(self) -> Message | None:
        """The newest wish since the last call; those from before this process's start do not count."""
        if self.ring is None:
            try:
                self.ring = RingReader.open(self.path, wire.TRIGGER_KIND)
            except RingUnavailable:
                return None
            self.last_index = self.ring.index
        if self.ring.index == self.last_index:
            return None
        wish = self.ring.newest()
        self.last_index = wish.index if wish else self.last_index
        return wish


def run(kind: str, runtime_dir: Path, driver: str, settings: Settings, picture_bytes: int) -> None:
    """Open the driver and host it; returns only by an exception."""
    clock = SystemClock()
    health = HealthReporter(runtime_dir, kind, clock)
    health.keep_beating()
    try:
        health.report("starting", f"opening {driver}")
        device = driver_module(driver).open(settings, clock)
        log.info("device_open", driver=driver)
        if kind == "robot":
            host_robot(device, runtime_dir, health, clock)
        elif kind == "pedal":
            host_pedal(device, runtime_dir, health)
        else:
            host_camera(device, runtime_dir, health, clock, picture_bytes)
    except DeviceUnavailable as err:
        health.report("unavailable", str(err))
        raise
    except (DeviceRefused, ConfigError) as err:
        health.report("refused", str(err))
        raise


def main(argv: list[str] | None = None) -> int:
    """Entry point of a device process; the exit code is the error's."""
    kind, runtime_dir, driver, settings, picture_bytes = (argv or sys.argv)[1:]
    logs.configure(kind)
    try:
        run(kind, Path(runtime_dir), driver, json.loads(settings), int(picture_bytes))
    except VgrdError as err:
        log.warning("device_lost", driver=driver, reason=str(err))
        return err.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
