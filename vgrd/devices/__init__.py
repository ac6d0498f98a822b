"""Devices: what the daemon asks of them, and the process that runs each.

A driver knows `interface` only; its names are the doors of this folder. May import geometry and ipc.
"""

from vgrd.devices.interface import (
    DEPTHS,
    SLOWEST_ROBOT_HZ,
    Camera,
    CameraImage,
    DriverCard,
    FlangeReading,
    Grey,
    Pedal,
    Pixels,
    Region,
    Robot,
    Setting,
    SettingRemark,
    Settings,
    full_scale,
    guessed_bits,
)

__all__ = [
    "DEPTHS",
    "SLOWEST_ROBOT_HZ",
    "Camera",
    "CameraImage",
    "DriverCard",
    "FlangeReading",
    "Grey",
    "Pedal",
    "Pixels",
    "Region",
    "Robot",
    "Setting",
    "SettingRemark",
    "Settings",
    "full_scale",
    "guessed_bits",
]
