"""A pedal, foot switch or button on a serial port that sends something when it is pressed.

What switches with a microcontroller, barcode triggers and USB-serial buttons send is a byte or a line; any will do.
What comes within `quiet_s` belongs to the same press: contacts bounce, and a line has several bytes.
"""

import serial

from drivers import settings as driver_settings
from drivers.catalogue import PedalSettings
from vgrd.clock import Clock
from vgrd.devices import Pedal, Settings
from vgrd.errors import DeviceUnavailable

_SOURCE = "settings of driver serial_pedal"


def open(settings: Settings, clock: Clock) -> Pedal:  # noqa: A001 - the name of every driver's entry
    """Open the port; settings as in `PedalSettings`. Raises ConfigError, DeviceUnavailable."""
    options = driver_settings.parse(PedalSettings, settings, _SOURCE)
    try:
        port = serial.Serial(options.serial_port, options.baud, exclusive=True)
        port.reset_input_buffer()
    except (OSError, serial.SerialException) as error:
        raise DeviceUnavailable(
            f"cannot open the pedal's port {options.serial_port}: {error}"
        ) from error
    return SerialPedal(port, options.quiet_s, clock)


class SerialPedal:
    """An open pedal; see `open`."""

    def __init__(self, port: serial.Serial, quiet_s: float, clock: Clock) -> None:
        self._port = port
        self._quiet_s = quiet_s
        self._clock = clock
        self._next_s = clock.monotonic()

    def wait_press(self, timeout_s: float) -> float | None:
        """As `vgrd.devices.Pedal.wait_press`."""
        end_s = self._clock.monotonic() + timeout_s
        while (left_s := end_s - self._clock.monotonic()) > 0:
            try:
                self._port.timeout = left_s
                told = self._port.read(1)
            except (
                OSError,
                serial.SerialException,
                TypeError,
            ) as error:  # TypeError: it was closed
                raise DeviceUnavailable(
                    f"the pedal at {self._port.port} is lost: {error}"
                ) from error
            now_s = self._clock.monotonic()
            if told and now_s >= self._next_s:
                self._next_s = now_s + self._quiet_s
                return now_s
        return None

    def close(self) -> None:
        """Release the port; may be called more than once."""
        self._port.close()
