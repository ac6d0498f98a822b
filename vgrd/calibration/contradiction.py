"""What a picture that contradicts the calibration means, in words, with the remedy for each link."""

from collections.abc import Mapping

from vgrd.errors import Contradiction
from vgrd.model import Link, LinkReport

_SIGNIFICANT_MM = 0.01  # a slip below it moved nothing that matters

_ADOPT = "fasten it and teach anew, or take a small slip over: vgrd confirm --accept"
_REMEDIES: Mapping[Link, str] = {
    Link.CAMERA: "the camera stands elsewhere: bring tag A into view, it tells where",
    Link.TAG_A: f"tag A sits elsewhere on the flange: {_ADOPT} 'tag A'",
    Link.TAG_B: f"tag B sits elsewhere on the object: {_ADOPT} 'tag B'",
    Link.OBJECT: "the object left its turntable or its plane: seat it as it was taught",
}


def words_of(report: LinkReport) -> str:
    """One sentence for each link that may have moved, most likely first."""
    parts = []
    for link in report.suspects:
        mm, rad = report.slips.get(link, (0.0, 0.0))
        size = f" ({mm:.2f} mm, {1e3 * rad:.1f} mrad)" if mm > _SIGNIFICANT_MM else ""
        parts.append(_REMEDIES[link] + size)
    return "the picture contradicts the calibration: " + "; or ".join(parts)


def contradiction_of(report: LinkReport) -> Contradiction:
    """The error of a picture that must not be served."""
    links = [link.value for link in report.suspects]
    return Contradiction(words_of(report), links, report.size_mm)
