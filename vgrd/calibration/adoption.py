"""A small slip of a tag that a person takes over: the calibration with the tag where it sits now.

What the pictures tell of the slip is put in. The uncertainty grows by the whole of it, and by as much again
in the directions that no picture tells. It holds until its term ends, unless a verification touch bears
it out.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.verification import verify
from vgrd.errors import InputError
from vgrd.geometry import Array
from vgrd.model import AdoptedSlip, Link, SlipEstimate, Touch

TERM_S = 8 * 3600.0  # chosen: a shift

_WORDS: Mapping[Link, str] = {
    Link.CAMERA: "the camera is followed by tag A, there is nothing to take over",
    Link.OBJECT: "the object stands off its turntable or its plane: seat it as it was taught",
}


def link_called(name: str) -> Link:
    """The link of that name, such as "tag B"; InputError with the names there are."""
    try:
        return Link(name)
    except ValueError:
        raise InputError(f"link {name!r}: choose one of {', '.join(Link)}") from None


def adopt(
    calibration: Calibration,
    slip: SlipEstimate,
    most_mm: float,
    most_rad: float,
    by: str,
    now_unix_s: float,
) -> Calibration:
    """The calibration after the slip; most_mm, most_rad: of all slips since teaching together.

    Raises InputError for a link that cannot be taken over, and for a slip that is too large.
    """
    if slip.link in _WORDS:
        raise InputError(f"{slip.link} cannot be taken over: {_WORDS[slip.link]}")
    new = AdoptedSlip(
        slip.link, slip.size_mm, slip.size_rad, calibration.id, by, now_unix_s, now_unix_s + TERM_S
    )
    adopted = (*calibration.adopted, new)
    mm, rad = sum(one.size_mm for one in adopted), sum(one.size_rad for one in adopted)
    if mm > most_mm or rad > most_rad:
        raise InputError(
            f"{slip.link} slipped by {slip.size_mm:.2f} mm, {1e3 * slip.size_rad:.1f} mrad; with all slips "
            f"since teaching that is {mm:.2f} mm, {1e3 * rad:.1f} mrad, at most {most_mm:g} mm and "
            f"{1e3 * most_rad:g} mrad may be taken over: fasten it and teach anew"
        )
    return replace(
        calibration, id="", solution=calibration.solution.after_slip(slip), adopted=adopted
    )


def bear_out(calibration: Calibration, touch: Touch, stability: Array) -> Calibration | str:
    """The calibration without a term, by a verification touch; in words why the touch speaks against it.

    stability: (6,) of the camera, as in `CameraPlace`.
    """
    findings, _ = verify(calibration, [touch], stability)
    if findings:
        return "; ".join(finding.message for finding in findings)
    adopted = tuple(replace(one, term_unix_s=math.inf) for one in calibration.adopted)
    return replace(calibration, id="", adopted=adopted)


def term_unix_s(calibration: Calibration) -> float:
    """Until when it may serve; infinite where nothing was taken over, or a touch has borne it out."""
    return float(np.min([one.term_unix_s for one in calibration.adopted], initial=math.inf))
