"""A child process that opens one device, reads it, and tells in a JSON line: drivers can hang or abort.

python -m vgrd.checking.probe robot|camera|pedal DRIVER SETTINGS_JSON PICTURE_FILE
"""

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from vgrd.clock import Clock, SystemClock
from vgrd.devices import Camera, FlangeReading, Pedal, Robot
from vgrd.devices.checks import FlangeCheck, FrameCheck
from vgrd.devices.host import GRAB_TIMEOUT_S, READ_TIMEOUT_S, driver_module
from vgrd.devices.rate import reading_period_s
from vgrd.devices.stillness import rest_pose_since
from vgrd.errors import BadReading, DeviceUnavailable, NotSteady, ObservationError, VgrdError
from vgrd.geometry.pose_formats import mm_and_degrees

_READ_S = 1.0  # five readings of the slowest robot (5 Hz), a hundred of the others
_MOST_BAD = 5  # as BAD_PICTURES_IN_A_ROW: the first pictures after a start may be cut short


def read_robot(robot: Robot, clock: Clock) -> dict[str, object]:
    """Where the flange is, which TCP is active, and whether the arm stands."""
    check, readings = FlangeCheck(clock), list[FlangeReading]()
    start_s = clock.monotonic()
    while clock.monotonic() < start_s + _READ_S:
        readings.append(check.accept(robot.read_flange(READ_TIMEOUT_S)))
    try:
        rest_pose_since(readings, start_s)
        rest = "yes"
    except NotSteady as err:
        rest = f"no: {err}"
    except ObservationError as err:
        rest = f"not known: {err}"
    last, tcp = readings[-1], readings[-1].wrist_from_tcp
    return {
        "flange": mm_and_degrees(last.base_from_wrist),
        "tcp": None if tcp is None else mm_and_degrees(tcp),
        "at_rest": rest,
        "running": last.running,
        "readings_per_s": round(1 / reading_period_s(readings), 1),
    }


def take_picture(camera: Camera, path: Path) -> dict[str, object]:
    """Save a picture as .npy, and tell its size."""
    check, reason = FrameCheck(), ""
    for _ in range(_MOST_BAD):
        try:
            image = check.accept(camera.grab(GRAB_TIMEOUT_S))
        except BadReading as err:
            reason = str(err)
            continue
        np.save(path, image.pixels)
        height, width = image.pixels.shape
        return {"size_px": [width, height], "bits": 8 * image.pixels.itemsize}
    raise DeviceUnavailable(f"{_MOST_BAD} bad pictures in a row, the last: {reason}")


def find_pedal(_: Pedal) -> dict[str, object]:
    """Nothing more can be told of a pedal that nobody presses."""
    return {"opened": True}


def probe(kind: str, driver: str, settings: Mapping[str, object], picture: Path) -> object:
    """Open the device, ask it, close it. Raises what the driver raises."""
    clock = SystemClock()
    ask: dict[str, Callable[..., dict[str, object]]] = {
        "robot": lambda robot: read_robot(robot, clock),
        "camera": lambda camera: take_picture(camera, picture),
        "pedal": find_pedal,
    }
    device = driver_module(driver).open(settings, clock)
    try:
        return ask[kind](device)
    finally:
        device.close()


def main() -> int:
    """Entry point; the last line of the output is the answer."""
    kind, driver, settings, picture = sys.argv[1:]
    try:
        told = {"told": probe(kind, driver, json.loads(settings), Path(picture))}
    except VgrdError as err:
        told = {"error": type(err).__name__, "message": str(err)}
    sys.stdout.write(f"\n{json.dumps(told)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
