"""A first guess of all unknowns of the joint estimate, from closed forms."""

import numpy as np

from vgrd.calibration.joint.problem import JointData
from vgrd.calibration.joint.start.cameras import (
    as_taught,
    guess_hand_eye,
    guess_places,
    guess_reference,
)
from vgrd.calibration.joint.start.touches import guess_bare, guess_object, turned_back
from vgrd.calibration.joint.state import JointState, table_motion_of
from vgrd.calibration.turntable import RotationCenter, find_rotation_center
from vgrd.errors import NotObservable, TooFewObservations
from vgrd.geometry import Pose


def guess(data: JointData) -> JointState:
    """First values from closed forms.

    Raises TooFewObservations where not even a guess is possible.
    """
    taught_from_camera: tuple[Pose, ...] = ()
    if data.places.displaced:
        base_from_camera, wrist_from_tag_a, taught_from_camera = guess_places(data)
        data = as_taught(data, taught_from_camera)
        camera_from_tag_b = guess_reference(data.reference)
    else:
        camera_from_tag_b = guess_reference(data.reference)
        base_from_camera, wrist_from_tag_a = guess_hand_eye(data.looks)
    data = turned_back(data, base_from_camera, camera_from_tag_b)
    by_touches, tcp, is_tied = guess_object(data)
    # Without CAD nothing tells of the object's frame, and nothing needs it: tag B's is as good as any.
    base_from_object = by_touches or base_from_camera @ camera_from_tag_b
    center = _guess_center(data)
    if center is not None and data.center is not None and not is_tied:
        center_in_base = base_from_camera @ center.center_in_camera
        axis = base_from_camera.rotation @ center.axis_in_camera
        shift = center_in_base - base_from_object @ data.center
        shift = shift - axis * float(axis @ shift)
        R = data.touches.rotations[0]
        base_from_object = Pose(base_from_object.rotation, base_from_object.translation + shift)
        tcp = tcp + R.T @ shift
    camera_from_object = base_from_camera.inverse() @ base_from_object
    camera_from_axis = _guess_axis(data, center, camera_from_object)
    table_motion = [
        table_motion_of(
            camera_from_axis, camera_from_tag @ camera_from_tag_b.inverse(), data.motion
        )
        for camera_from_tag in data.spins.poses()
    ]
    points = data.points
    spike = (points.rotations @ tcp + points.translations).mean(axis=0) if len(points) else tcp
    return JointState(
        base_from_camera,
        wrist_from_tag_a,
        tcp,
        base_from_object,
        camera_from_tag_b,
        camera_from_axis,
        np.array(table_motion).reshape(-1, 3),
        spike,
        np.zeros(data.corrections.count),
        taught_from_camera,
        guess_bare(data, tcp),
        np.zeros((len(data.inexact), 3)),
    )


def _guess_center(data: JointData) -> RotationCenter | None:
    try:
        return find_rotation_center(data.spins.poses())
    except (NotObservable, TooFewObservations):
        return None


def _guess_axis(data: JointData, center: RotationCenter | None, camera_from_object: Pose) -> Pose:
    """Frame with z along the axis, CAD's z up; origin: the centre in CAD, brought onto the axis seen."""
    origin = camera_from_object @ (np.zeros(3) if data.center is None else data.center)
    z = camera_from_object.rotation[:, 2]
    if center is not None:
        z = center.axis_in_camera * np.copysign(1.0, center.axis_in_camera @ z)
        origin = center.at_height(origin)[1]
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(z, x), z]), origin)
