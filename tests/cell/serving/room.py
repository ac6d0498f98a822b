"""A taught cell in which tags are seen with noise, not in pictures: many answers in little time."""

import numpy as np

from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.teaching import VISION, calibrations
from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.places import base_from_tag
from vgrd.cell.serving.limits import Excess, excess_of
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import (
    Bounds,
    CameraPlace,
    CellBounds,
    ExpectedCoordinate,
    Motion,
    Policy,
    TagObservation,
)

CAMERA = CameraPlace(np.array([0.5] * 3 + [5e-4] * 3))
MARGIN_MM = Bounds().margin_mm


class Room:
    """A taught cell and its truth; tags are seen with noise, not in pictures."""

    def __init__(
        self, motion: Motion = Motion.TURNTABLE, calibration: Calibration | None = None
    ) -> None:
        self.motion = motion
        self.calibration = calibration or calibrations(motion)[0]
        self.plant = Plant()
        self.rng = np.random.default_rng(4)

    def object_at(self, angle_rad: float) -> Pose:
        """As its motion allows it: turned, put elsewhere on the table, tilted."""
        shift, tilt = np.zeros(3), np.eye(3)
        if self.motion is not Motion.TURNTABLE:
            shift[:2] = self.rng.uniform(-40, 40, 2)
        if self.motion is Motion.FREE:
            tilt = exp_rotation(self.rng.uniform(-0.2, 0.2, 3))
        table = self.plant.layout.base_from_table
        return table @ Pose(tilt, shift) @ Pose.from_rotvec((0.0, 0.0, angle_rad))

    def tag(self, base_from_object: Pose) -> TagObservation:
        layout = self.plant.layout
        camera_from_base = layout.base_from_camera.inverse()
        there = camera_from_base @ base_from_object @ layout.object_from_tag_b
        return VISION.observe(self.rng, layout.tag_b, there)

    def expected(
        self, target: str, tag: TagObservation, policy: Policy, work: Array | None = None
    ) -> ExpectedCoordinate:
        return expected_coordinate(self.calibration, target, tag, policy, work, CAMERA)

    def excess(
        self,
        pose: Pose,
        tag: TagObservation,
        policy: Policy,
        target: str = "P1",
        bounds: CellBounds | None = None,
        taught_from_camera: Pose | None = None,
    ) -> Excess | None:
        moved = taught_from_camera or Pose.identity()
        seen = base_from_tag(self.calibration, tag, moved)
        return excess_of(self.calibration, target, pose, policy, bounds or CellBounds(), seen)
