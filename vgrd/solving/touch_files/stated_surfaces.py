"""A plane or a radius that a file states, held against what its touches find without it."""

from dataclasses import replace

import numpy as np

from vgrd.calibration.tcp import SurfaceDifference, plane_difference, radius_difference
from vgrd.errors import CalibrationError
from vgrd.judging.findings import finding
from vgrd.judging.thresholds import CHANCE
from vgrd.model import Finding
from vgrd.solving.touch_files.document import TouchFile
from vgrd.solving.touch_files.fitting import Estimate, fit_touches


def find_stated_off(file: TouchFile) -> Finding | None:
    """That the stated plane or radius is off beyond chance; None where the touches find none by themselves."""
    if file.plane is None and file.radius_mm is None:
        return None
    try:
        found = fit_touches(replace(file, plane=None, radius_mm=None))
    except CalibrationError:
        return None
    if file.plane is not None:
        touches = file.touches.weighted(found.fit.used.astype(float))
        return _plane_off(plane_difference(found.fit.result, touches, file.plane), found)
    stated_mm = float(file.radius_mm or 0.0)
    return _radius_off(radius_difference(found.fit.result, stated_mm), found, stated_mm)


def _plane_off(off: SurfaceDifference, found: Estimate) -> Finding | None:
    if off.chance >= CHANCE:
        return None
    tilt, spread = np.degrees(off.found_less_stated[1:]), np.degrees(off.sigmas[1:])
    return finding(
        "plane_off",
        f"by the touches the plane lies {off.found_less_stated[0]:+.2f} mm (sigma {off.sigmas[0]:.2g}) along its "
        f"normal from where it is stated, tilted by {np.linalg.norm(tilt):.2f} deg (sigma {spread.max():.2g}), "
        f"{_tcp_words(found)}",
        fatal=True,
    )


def _radius_off(off: SurfaceDifference, found: Estimate, stated_mm: float) -> Finding | None:
    if off.chance >= CHANCE:
        return None
    radius_mm = stated_mm + off.found_less_stated[0]
    return finding(
        "radius_off",
        f"by the touches the radius is {radius_mm:.2f} mm (sigma {off.sigmas[0]:.2g}), {stated_mm:g} mm is stated, "
        f"{_tcp_words(found)}",
        fatal=True,
    )


def _tcp_words(found: Estimate) -> str:
    x, y, z = found.tcp_in_wrist
    return f"and the TCP is ({x:.1f}, {y:.1f}, {z:.1f}) then"
