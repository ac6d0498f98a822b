"""Where the object is seen although touches leave it open, as one wrist without a TCP does."""

import numpy as np

from vgrd.calibration.joint.rows import left_jacobian
from vgrd.calibration.joint.state import JointState, StepLayout
from vgrd.geometry import Array

HEIGHT_SIGMA_MM = 3.0  # targets and tag lie on one plate, give or take its thickness


def near_tag_plane(
    state: JointState, layout: StepLayout, covariance: Array, points_in_object: Array
) -> JointState:
    """The state moved, within its covariance (n, n), so that points (m, 3) lie in tag B's plane.

    The plane counts as known to HEIGHT_SIGMA_MM: next to nothing beside touches that tell the height.
    """
    in_base = state.base_from_object @ points_in_object
    in_camera = state.base_from_camera.inverse() @ in_base
    tag_b_from_camera = state.camera_from_tag_b.inverse()
    down = tag_b_from_camera.rotation[2]
    H = np.zeros((len(in_base), layout.size))
    H[:, StepLayout.OBJECT] = (down @ state.base_from_camera.rotation.T) @ left_jacobian(in_base)
    H[:, StepLayout.CAMERA] = -H[:, StepLayout.OBJECT]
    H[:, StepLayout.TAG_B] = -down @ left_jacobian(in_camera)
    spread = H @ covariance @ H.T + HEIGHT_SIGMA_MM**2 * np.eye(len(H))
    heights = (tag_b_from_camera @ in_camera)[:, 2]
    return state.retract(-covariance @ H.T @ np.linalg.solve(spread, heights), layout)
