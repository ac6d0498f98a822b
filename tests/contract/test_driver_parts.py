"""The parts that drivers share: clock mapping, poses from the wire, the RTDE handshake."""

import math
import socket
import struct
import threading

import numpy as np
import pytest

from drivers.clock_mapping import ClockMapping
from drivers.rtde_session import RtdeConnection
from drivers.ur_rtde import pose_from_wire
from fakes.testing import free_loopback
from vgrd.clock import SystemClock
from vgrd.errors import BadReading, DeviceRefused


def test_the_mapping_finds_the_offset_of_two_clocks_under_random_delay():
    rng = np.random.default_rng(3)
    mapping = ClockMapping()
    for device_s in np.arange(0.0, 5.0, 0.008):
        mapping.add(device_s, device_s + 77.0 + 0.001 + rng.exponential(0.004))
    assert mapping.cell_s(5.0) == pytest.approx(82.001, abs=1e-4)


def test_the_mapping_follows_a_drift_of_the_clocks():
    mapping = ClockMapping(window_s=10.0)
    drift = 1.0 + 50e-6
    for cell_s in np.arange(0.0, 300.0, 0.05):
        mapping.add(cell_s * drift, cell_s)
    assert mapping.cell_s(300.0 * drift) == pytest.approx(300.0, abs=1e-3)


@pytest.mark.parametrize(
    "values",
    [
        (0, 0, 0, 0, 0, math.nan),
        (math.inf, 0, 0, 0, 0, 0),
        (0, 0, 0, 2 * math.pi, 0.01, 0),
    ],
)
def test_what_cannot_be_a_pose_is_a_bad_reading(values):
    with pytest.raises(BadReading):
        pose_from_wire(values)


def test_metres_become_millimetres():
    assert pose_from_wire((0.1, -0.2, 0.3, 0, 0, 1)).translation == pytest.approx((100, -200, 300))


@pytest.mark.parametrize("reply", [b"\x00\x01V", struct.pack(">HB", 3, ord("V"))])
def test_a_server_that_does_not_speak_rtde_is_refused(reply):
    host = free_loopback(30004)
    with socket.create_server((host, 30004)) as server:

        def answer():
            peer, _ = server.accept()
            with peer:
                peer.recv(100)
                peer.sendall(reply)
                peer.recv(100)

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(DeviceRefused):
            RtdeConnection(host, 125.0, 0.5, SystemClock())
        thread.join()
