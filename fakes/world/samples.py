"""Random but valid model values for the tests of whatever stores or sends them."""

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.stepwise import CameraChain, Pivot, UniversalSolution
from vgrd.devices import CameraImage, FlangeReading
from vgrd.geometry import Array, Pose
from vgrd.model import (
    CellFacts,
    Finding,
    Mount,
    ObjectSpec,
    Observation,
    TagObservation,
    TagSpec,
    Target,
    TaughtPoint,
    TcpEstimate,
    Tool,
    Touch,
    Verdict,
    frozen_array,
)

TAG_A = TagSpec("36h11", 0, 25.0)  # any
TAG_B = TagSpec("36h11", 1, 25.0)  # any other


class Samples:
    """Draws model values from one seed; none of them means anything."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def array(self, *shape: int) -> Array:
        """Frozen normal numbers of every magnitude from 1e-3 to 1e3."""
        return frozen_array(
            self.rng.normal(size=shape) * 10.0 ** self.rng.uniform(-3, 3, shape), *shape
        )

    def pose(self) -> Pose:
        """Any orientation, half a metre around the origin."""
        return Pose.from_rotvec(self.rng.normal(size=3), self.rng.normal(size=3) * 500)

    def tag(self, spec: TagSpec) -> TagObservation:
        """One sighting of a tag."""
        return TagObservation(
            spec, self.pose(), self.array(6, 6), self.array(4, 2), float(self.rng.uniform())
        )

    def observation(self) -> Observation:
        """Tag B seen, tag A sometimes."""
        tag_a = self.tag(TAG_A) if self.rng.integers(2) else None
        return Observation(self.pose(), float(self.rng.uniform(0, 1e5)), tag_a, self.tag(TAG_B))

    def touch(self, target: str = "P1") -> Touch:
        """Touch that tells nothing along the tool axis."""
        return Touch(target, self.pose(), 0.233, float("inf"), self.observation())

    def flange(self, stamp_s: float) -> FlangeReading:
        """Robot reading at `stamp_s` of the cell clock."""
        return FlangeReading(self.pose(), self.pose(), stamp_s, float(self.rng.uniform(0, 1e5)), 5)

    def image(
        self,
        stamp_s: float,
        frame: int,
        height: int = 60,  # small, so that a test may draw many
        width: int = 80,  # idem
    ) -> CameraImage:
        """Grey noise."""
        pixels = self.rng.integers(0, 256, (height, width), dtype=np.uint8)
        return CameraImage(pixels, stamp_s, frame)

    def target(self, number: int) -> Target:
        """CAD point, with a work orientation for odd numbers."""
        work = self.pose().rotation if number % 2 else None
        return Target(number, f"P{number}", self.array(3), work)

    def facts(self) -> CellFacts:
        """Cell with six targets on a turntable."""
        return CellFacts(
            mount=Mount.EYE_TO_HAND,
            camera_matrix=self.array(3, 3),
            distortion=self.array(5),
            image_size_px=(4024, 3036),
            tag_a=TAG_A,
            tag_b=TAG_B,
            tool=Tool("pin", self.array(3), self.array(3)),
            object=ObjectSpec({f"P{i}": self.target(i) for i in range(6)}, center_in_object=None),
            robot_id="UR5e 20235",
            wrist_from_tcp=self.pose(),
        )

    def calibration(self) -> Calibration:
        """Calibration that was accepted with one remark."""
        facts = self.facts()
        taught = {
            name: TaughtPoint(target, self.array(3), self.pose().rotation, self.array(3, 3))
            for name, target in facts.object.targets.items()
        }
        return Calibration(
            id="",
            session="s1",
            created_unix_s=1.7e9,
            facts=facts,
            taught=taught,
            solution=UniversalSolution(
                chain=CameraChain(self.pose(), self.array(6, 6), self.pose(), self.array(6, 6)),
                wrist_from_tag_a=self.pose(),
                pivot=Pivot(self.array(3), self.array(3), self.array(3, 3)),
                touch_covariances={name: self.array(9, 9) for name in taught},
                tcp=TcpEstimate(self.array(3), self.array(3, 3)),
            ),
            residuals={"touch_rms_mm": 0.2, "axis_sigma": float("inf")},
            verdict=Verdict((Finding("few-looks", "take three looks more"),)),
        )
