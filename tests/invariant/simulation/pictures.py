"""Pictures that are none: a number among grey noise, and a detector that knows what was exposed by that number."""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.teaching import VISION
from vgrd.devices import Pixels, Region
from vgrd.geometry import Array, Pose
from vgrd.model import TagObservation

SHAPE = (8, 512)  # the first row is compared with that of the picture before
ROW = 4  # of the number
KEPT = 400  # exposures, the newest: more than are in rings and in flight
NUMBER_BYTES = 16  # of four words: magic, number, and how large a region is
SAME = 1e-6  # mm and rad: the last digits of two poses that are one
MAGIC = 0x5EED


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What was exposed at `stamp_s`.

    errors: (6,) by tag that is seen, left tangent in the camera, mm and rad: how its pose in this picture, without
    noise, differs from that of a tag that sits where it was taught, on an object that moved as it may, seen by a robot
    that tells the truth. camera_shift: in the camera's frame. base_from_object: the truth. wrongs: in words, what is
    not as it was taught. base_from_flange: where the arm was.
    """

    stamp_s: float
    tags: Mapping[int, TagObservation]
    errors: Mapping[str, Array]
    camera_shift: Pose
    base_from_object: Pose
    wrongs: tuple[str, ...]
    base_from_flange: Pose = field(default_factory=Pose.identity)


class Film:
    """Exposes the plant; the detector of the cell looks here for what is in a picture."""

    def __init__(self, plant: Plant, rng: np.random.Generator) -> None:
        self.plant = plant
        self.rng = rng
        self.exposures: OrderedDict[int, Exposure] = OrderedDict()
        self.outlier: tuple[str, Pose] | None = None  # of the next picture alone
        self._count = 0

    def expose(self, stamp_s: float, reported: Pose, region: Region | None) -> Pixels:
        """Take a picture. reported: the flange as the robot tells it; region: None for the whole."""
        self._count += 1
        self.exposures[self._count] = self._exposure(stamp_s, reported)
        while len(self.exposures) > KEPT:
            self.exposures.popitem(last=False)
        pixels = self.rng.integers(60, 200, SHAPE, dtype=np.uint8)
        part = (0, 0) if region is None else (region.width, region.height)
        pixels[ROW, :NUMBER_BYTES] = np.array([MAGIC, self._count, *part], np.uint32).view(
            np.uint8
        )
        return pixels

    def detect(
        self,
        pixels: Pixels,
        previous: Mapping[int, TagObservation] | None = None,
        region: Region | None = None,
    ) -> dict[int, TagObservation]:
        """What `TagDetector` would find: nothing in pixels that are no picture of this film."""
        del previous
        if pixels.shape != SHAPE:
            return {}
        words = np.ascontiguousarray(pixels[ROW, :NUMBER_BYTES]).view(np.uint32)
        magic, number, width, height = map(int, words)
        exposure = self.exposures.get(number) if magic == MAGIC else None
        if exposure is None:
            return {}
        if region is not None:
            region = Region(region.x, region.y, width, height)
        return {
            i: tag
            for i, tag in exposure.tags.items()
            if region is None or _is_inside(tag.corners_px, region)
        }

    def _exposure(self, stamp_s: float, reported: Pose) -> Exposure:
        plant, outlier = self.plant, self.outlier
        self.outlier = None
        tags: dict[int, TagObservation] = {}
        errors: dict[str, Array] = {}
        for name, spec in (("a", plant.layout.tag_a), ("b", plant.layout.tag_b)):
            if name in plant.covered or plant.is_dark:
                continue
            camera_from_tag = plant.tag_in_camera(name, stamp_s)
            camera_from_tag = Pose(
                camera_from_tag.rotation, camera_from_tag.translation * (1, 1, plant.lens)
            )
            if outlier is not None and outlier[0] == name:
                camera_from_tag = camera_from_tag @ outlier[1]
            corners = self._corners(camera_from_tag, spec.size_mm)
            if corners is None:
                continue
            seen = VISION.observe(self.rng, spec, camera_from_tag)
            tags[spec.id] = replace(seen, corners_px=corners)
            taught = plant.tag_in_camera(name, stamp_s, slipped=False)
            if name == "a":
                told = plant.arm.true_at(reported) @ plant.layout.wrist_from_tag_a
                taught = plant.base_from_camera.inverse() @ told
            errors[name] = (camera_from_tag @ taught.inverse()).log()
        wrongs = [*plant.wrongs]
        if outlier is not None:
            wrongs.append(f"outlier of tag {outlier[0]}")
        if max(reported.distance(plant.arm.reported_flange(stamp_s))) > SAME:
            wrongs.append("robot tells an old pose")
        return Exposure(
            stamp_s,
            tags,
            errors,
            plant.camera_shift,
            plant.base_from_object(stamp_s),
            tuple(wrongs),
            plant.arm.reported_flange(stamp_s),
        )

    def _corners(self, camera_from_tag: Pose, size_mm: float) -> Array | None:
        """Corners (4, 2), px; None where the camera does not see them."""
        optics = self.plant.layout.optics
        half = size_mm / 2
        square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        points = camera_from_tag.apply(square)
        if points[:, 2].min() < 1.0 or camera_from_tag.rotation[2, 2] < 0.1:
            return None
        pixels = optics.project(points)
        is_inside = (pixels >= 0).all() and (pixels < np.array(optics.size_px)).all()
        return pixels if is_inside else None


def _is_inside(corners_px: Array, region: Region) -> bool:
    low, high = corners_px.min(0), corners_px.max(0)
    return bool(
        (low >= (region.x, region.y)).all()
        and (high <= (region.x + region.width, region.y + region.height)).all()
    )
