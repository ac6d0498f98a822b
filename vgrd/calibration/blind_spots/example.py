"""A calibrated cell of plain numbers, for the page: what it tells holds for any other that is not special."""

from dataclasses import dataclass

import numpy as np

from vgrd.calibration.joint import JointSolution, StepLayout
from vgrd.geometry import Array, Pose
from vgrd.model import (
    ArmKnowledge,
    ArmModel,
    CellFacts,
    FlangeTag,
    Motion,
    Mount,
    ObjectSpec,
    TagObservation,
    TagSpec,
    Target,
    Tool,
    frozen_array,
)

_SIGMAS = np.array([0.1] * 3 + [2e-4] * 3)  # mm, rad: of poses and pictures; any would do
_LAYOUTS = {  # axis and object's motions, as the joint estimate has them
    Motion.TURNTABLE: ((3, 4, 0, 1), (5,)),
    Motion.PLANAR: ((3, 4), (5, 0, 1)),
    Motion.FREE: ((), ()),
}


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """A solution, its cell, and one picture: tag B on the object, tag A on the flange."""

    solution: JointSolution
    facts: CellFacts
    tag_b: TagObservation
    tag_a: FlangeTag


def example(motion: Motion) -> Example:
    """A camera 700 mm up that looks down obliquely, the object below it, no angle a special one."""
    base_from_camera = Pose.from_rotvec((3.0, 0.3, 0.1), (350.0, 0.0, 700.0))
    base_from_axis = Pose.from_rotvec((0.02, -0.01, 0.0), (350.0, 20.0, 50.0))
    base_from_tag_b = base_from_axis @ Pose.from_rotvec((3.1, 0.2, 0.1), (30.0, 40.0, 10.0))
    base_from_wrist = Pose.from_rotvec((3.1, 0.3, 0.0), (300.0, 60.0, 300.0))
    wrist_from_tag_a = Pose.from_rotvec((3.1, 0.1, -0.1), (60.0, 20.0, 30.0))
    camera_from_base = base_from_camera.inverse()
    camera_from_tag_b = camera_from_base @ base_from_tag_b
    axis, object_motions = _LAYOUTS[motion]
    layout = StepLayout(axis, object_motions, spins=0, has_point=False)
    sigmas = np.where(layout.is_length(), _SIGMAS[0], _SIGMAS[3])
    facts = _facts(motion)
    solution = JointSolution(
        base_from_camera=base_from_camera,
        wrist_from_tag_a=wrist_from_tag_a,
        tip_in_wrist=frozen_array((5.0, -8.0, 120.0), 3),
        base_from_object=base_from_axis,
        camera_from_tag_b=camera_from_tag_b,
        camera_from_axis=camera_from_base @ base_from_axis,
        axis=axis,
        object_motions=object_motions,
        has_point=False,
        bare=(),
        bare_in_base=frozen_array(np.zeros((0, 3)), 0, 3),
        inexact=(),
        offsets_in_object=frozen_array(np.zeros((0, 3)), 0, 3),
        refined={},
        levels=(),
        covariance=frozen_array(np.diag(sigmas**2), layout.size, layout.size),
        undetermined=frozen_array(np.zeros((layout.size, 0)), layout.size, 0),
        arm=_arm(layout.size),
    )
    camera_from_tag_a = camera_from_base @ base_from_wrist @ wrist_from_tag_a
    seen = FlangeTag(_seen(facts.tag_b, camera_from_tag_a), base_from_wrist)
    return Example(solution, facts, _seen(facts.tag_b, camera_from_tag_b), seen)


def _seen(tag: TagSpec, camera_from_tag: Pose) -> TagObservation:
    J = camera_from_tag.adjoint() * _SIGMAS
    corners = frozen_array(np.zeros((4, 2)), 4, 2)
    return TagObservation(tag, camera_from_tag, frozen_array(J @ J.T, 6, 6), corners, 0.0)


def _arm(unknowns: int) -> ArmKnowledge:
    def nothing(*shape: int) -> Array:
        return frozen_array(np.zeros(shape), *shape)

    return ArmKnowledge(
        ArmModel(_SIGMAS[0]), nothing(0, 3), nothing(0), nothing(0, unknowns), nothing(0, 0)
    )


def _facts(motion: Motion) -> CellFacts:
    """Three targets on a circle of 80 mm; a camera of which only tags matter."""
    angles = (0.3, 2.1, 4.4)
    points = [frozen_array((80 * np.cos(a), 80 * np.sin(a), 0.0), 3) for a in angles]
    targets = {f"P{i}": Target(i, f"P{i}", point) for i, point in enumerate(points, 1)}
    tag = TagSpec("36h11", 1, 25.0)
    return CellFacts(
        mount=Mount.EYE_TO_HAND,
        camera_matrix=frozen_array(np.eye(3), 3, 3),
        distortion=frozen_array((), 0),
        image_size_px=(1, 1),
        tag_a=tag,
        tag_b=tag,
        tool=Tool(),
        object=ObjectSpec(targets, motion),
    )
