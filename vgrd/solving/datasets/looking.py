"""What one sample of a dataset shows of the target."""

import cv2
import numpy as np

from vgrd.errors import InputError, TagNotSeen
from vgrd.geometry import Pose
from vgrd.geometry.resection import checked_points
from vgrd.solving.datasets.reading.sample_reading import DatasetSample, PointInCamera
from vgrd.vision.images.pictures import check_whole
from vgrd.vision.print.boards import BoardObservation, TargetSpec
from vgrd.vision.print.targets import TagGrid
from vgrd.vision.tags.seeing import see_target


def observe(
    sample: DatasetSample,
    target: TargetSpec | TagGrid | None,
    picture_px: tuple[int, int] | None = None,
) -> BoardObservation | Pose:
    """What one sample shows; raises TagNotSeen, or InputError for what is no picture of picture_px.

    picture_px: (width, height) to which the intrinsics belong, None where that is not told.
    """
    match sample.source:
        case Pose():
            return sample.source
        case PointInCamera():
            raise InputError("point_in_camera is solved by itself, not with a target")
        case BoardObservation():
            try:
                checked_points(sample.source.points_in_target, sample.source.pixels)
            except InputError as error:
                raise TagNotSeen(str(error)) from error
            return sample.source
    check_whole(sample.source)
    image = cv2.imread(str(sample.source), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError(f"{sample.source} is not a picture that OpenCV can read")
    height, width = image.shape[:2]
    if picture_px is not None and picture_px != (width, height):
        raise InputError(
            f"{sample.source} has {width} x {height} px, the camera has {picture_px[0]} x "
            f"{picture_px[1]}: give the camera file of this picture"
        )
    if target is None:
        raise InputError("an image needs [target]")
    return see_target(np.asarray(image, dtype=np.uint8), target)
