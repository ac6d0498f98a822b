"""Which limit an answer would break: DETAIL of the statuses that tell so."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Final, Self

from vgrd.registers.codes import Status


class LimitCode(IntEnum):
    """DETAIL of 305, 601, 603 and 604: the limit, its keys of the cell file, and what is beyond it."""

    key: str
    description: str

    def __new__(cls, value: int, key: str = "", description: str = "") -> Self:
        """With the keys of the cell file, and what is beyond them."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.key, member.description = key, description
        return member

    FLANGE_X = 1, "lowest_mm, highest_mm", "the flange, in X"
    FLANGE_Y = 2, "lowest_mm, highest_mm", "the flange, in Y"
    FLANGE_Z = 3, "lowest_mm, highest_mm", "the flange, in Z"
    FLANGE_RADIUS = 4, "inner_radius_mm, outer_radius_mm", "the flange, from the base's z axis"
    TIP_X = 5, "lowest_mm, highest_mm", "the tip, in X"
    TIP_Y = 6, "lowest_mm, highest_mm", "the tip, in Y"
    TIP_Z = 7, "lowest_mm, highest_mm", "the tip, in Z"
    TIP_RADIUS = 8, "inner_radius_mm, outer_radius_mm", "the tip, from the base's z axis"
    PLACE_RADIUS = 11, "volume_margin_mm", "the target, from the axis of its object"
    PLACE_HEIGHT = 12, "volume_margin_mm", "the target, along the axis of its object"
    PLACE_IN_TAG = 13, "volume_margin_mm", "the target, from where the tag in the picture has it"
    SIDE = 21, "cone_deg", "the tool's axis, by more than 90 degrees: the wrong side"
    CONE = 22, "cone_deg", "the tool's axis, against the taught approach"
    STEP = 23, "step_mm", "the flange, from where it was taught"
    TURN = 24, "step_deg", "the wrist, from how it was taught"


LIMIT_STATUS: Final[Mapping[LimitCode, Status]] = {
    **{code: Status.OUT_OF_WORKSPACE for code in LimitCode if code <= LimitCode.TIP_RADIUS},
    LimitCode.PLACE_RADIUS: Status.OUTSIDE_CALIBRATED_VOLUME,
    LimitCode.PLACE_HEIGHT: Status.OUTSIDE_CALIBRATED_VOLUME,
    LimitCode.PLACE_IN_TAG: Status.OUTSIDE_CALIBRATED_VOLUME,
    LimitCode.SIDE: Status.POINT_NOT_VISIBLE,
    LimitCode.CONE: Status.UNREACHABLE,
    LimitCode.STEP: Status.UNREACHABLE,
    LimitCode.TURN: Status.UNREACHABLE,
}
