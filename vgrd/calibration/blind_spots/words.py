"""What one picture of a solved cell cannot tell, in sentences for people."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vgrd.calibration.blind_spots.courses import Course
from vgrd.calibration.blind_spots.slips import BlindSpot, blind_spots
from vgrd.calibration.joint import JointSolution
from vgrd.geometry import Array
from vgrd.model import CameraPlace, FlangeTag, Link, Recording, TagObservation

Spots = Mapping[Link, BlindSpot]

_COURSES: Mapping[Course, str] = {
    Course.ARC: "along the arc about the axis",
    Course.PLANE: "in the plane",
}
_OTHERS: Mapping[Course, str] = {
    Course.ARC: "Any other shift of it",
    Course.PLANE: "A shift out of the plane",
}


def sentences(solution: JointSolution, recording: Recording, stability: Array) -> tuple[str, ...]:
    """At most two, for the object as it was taught; stability: (6,) as in `CameraPlace`.

    None for a session that shows no tag A or no tag B.
    """
    tag_b, tag_a = _taught_tag_b(solution, recording), _taught_tag_a(solution, recording)
    if tag_b is None or tag_a is None:
        return ()
    seen = blind_spots(solution, recording.facts, tag_b, CameraPlace(stability, tag_a))
    hidden = None
    if not np.isinf(stability).all():
        hidden = blind_spots(solution, recording.facts, tag_b, CameraPlace(stability))
    return (_of_tag_b(seen, hidden), _of_the_rest(seen, hidden))


def _of_tag_b(seen: Spots, hidden: Spots | None) -> str:
    """What leaves no trace though both tags are seen, and from which size on the rest shows."""
    course, shows_mm = seen[Link.TAG_B].harmful.course, seen[Link.TAG_B].shows_from_mm
    told = (
        f"One picture cannot tell a slip of tag B {_COURSES.get(course, course)}: "
        "a second tag on the object, or its holes in the picture, would."
    )
    if course in _OTHERS and shows_mm is not None:
        told += f" {_OTHERS[course]} shows from {shows_mm:.2g} mm on"
        if hidden is not None and (hidden_mm := hidden[Link.TAG_B].shows_from_mm) is not None:
            told += f", from {hidden_mm:.2g} mm while tag A is hidden"
        told += "."
    return told


def _of_the_rest(seen: Spots, hidden: Spots | None) -> str:
    """What tag A and the camera may do that looks like a motion of the object."""
    told = []
    if seen[Link.TAG_A].harmful:
        told.append(
            "A slip of tag A that way is not told either: a second tag on the flange would."
        )
    if seen[Link.TAG_A].harmful_as_knock:
        told.append(
            "A slip of tag A that way passes for a knock of the camera: after a knock, send the tip "
            "to a target and look."
        )
    if hidden is not None and hidden[Link.CAMERA].harmful:
        told.append("A knock that way is not told while tag A is hidden: keep it in view.")
    return " ".join(told)


def _taught_tag_b(solution: JointSolution, recording: Recording) -> TagObservation | None:
    """Tag B where the solution has it, the object as taught, seen as well as in the session."""
    for touch in recording.touches:
        if touch.observation is not None and (tag := touch.observation.tag_b) is not None:
            return replace(tag, camera_from_tag=solution.camera_from_tag_b)
    return None


def _taught_tag_a(solution: JointSolution, recording: Recording) -> FlangeTag | None:
    """Tag A where the solution has it, from where the arm waited, seen as well as in the session."""
    for picture in (*recording.spins, *recording.looks, *recording.touch_pictures):
        if picture.tag_a is not None:
            in_base = picture.base_from_wrist @ solution.wrist_from_tag_a
            in_camera = solution.base_from_camera.inverse() @ in_base
            tag = replace(picture.tag_a, camera_from_tag=in_camera)
            return FlangeTag(tag, picture.base_from_wrist)
    return None
