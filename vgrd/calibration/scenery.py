"""Where things stand by an estimate, for drawings."""

import numpy as np

from vgrd.calibration.joint import JointSolution, StepLayout
from vgrd.geometry import Pose
from vgrd.geometry.covariance import radius95
from vgrd.judging.thresholds import IRRELEVANT_MM

_TIP_MM = (
    20.0  # a tip that is known worse is drawn at no place: it would stand visibly beside the tool
)


def scenery(solution: JointSolution) -> dict[str, object] | None:
    """Poses as matrices 4 x 4, mm, JSON-able; None where the samples leave the camera's place open.

    tip_in_wrist: (3,), None while it is hardly known. object_from_tag_b holds wherever the object stands;
    base_from_axis (z: the axis of turning) for the camera where it was taught.
    """
    if float(np.abs(solution.undetermined[StepLayout.CAMERA]).max(initial=0.0)) >= IRRELEVANT_MM:
        return None
    base_from_tag_b = solution.base_from_camera @ solution.camera_from_tag_b
    tcp = solution.tcp
    is_known = tcp is not None and radius95(tcp.covariance) < _TIP_MM
    return {
        "base_from_camera": _rows(solution.base_from_camera),
        "object_from_tag_b": _rows(solution.base_from_object.inverse() @ base_from_tag_b),
        "base_from_axis": _rows(solution.base_from_camera @ solution.camera_from_axis),
        "tip_in_wrist": np.asarray(solution.tip_in_wrist).tolist() if is_known else None,
    }


def _rows(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = pose.matrix().tolist()
    return rows
