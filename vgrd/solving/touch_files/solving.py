"""A file of touches in, the TCP with every touch's fate and a verdict out."""

from pathlib import Path

from vgrd.errors import NotObservable
from vgrd.model import Verdict
from vgrd.solving.touch_files.contradictions import misread, scaled
from vgrd.solving.touch_files.document import load_touches
from vgrd.solving.touch_files.fitting import find_orientation, fit_with_levels
from vgrd.solving.touch_files.judging import judge, reports
from vgrd.solving.touch_files.solution import TouchSolution
from vgrd.solving.touch_files.stated_surfaces import find_stated_off


def solve_touches(path: Path, *, tolerance_mm: float | None = None) -> TouchSolution:
    """TCP from a file of touches; bad touches are left out and named.

    tolerance_mm: what the tip has to be known to at 95 %; None for no verdict about that. Raises
    ConfigError (all faults of the file), TooFewObservations, NotObservable (names the missing motion)
    or DidNotConverge.
    """
    file = load_touches(path)
    try:
        levelled = fit_with_levels(file)
    except NotObservable as error:
        mistake = misread(file) or scaled(file) or find_stated_off(file)
        if mistake is None:
            raise
        raise NotObservable(
            f"{mistake.message} ({error})", rank=error.rank, unknowns=error.unknowns
        ) from error
    estimate = levelled.estimate
    return TouchSolution(
        tcp_in_wrist=estimate.tcp_in_wrist,
        covariance=estimate.covariance,
        object_from_base=estimate.object_from_base,
        touches=tuple(reports(file, estimate)),
        certificate=estimate.certificate,
        verdict=Verdict(tuple(judge(file, levelled, tolerance_mm))),
        levels=levelled.levels,
        tolerance_mm=tolerance_mm,
        orientation=find_orientation(file, levelled),
        rotation_format=file.rotation_format,
    )
