"""The limits of the cell file: where answers may send the arm."""

import math
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from vgrd.config.quantities import Positive
from vgrd.documents.tables import Table
from vgrd.model.limits import CONE_RAD, MARGIN_MM


def _no_nan(value: float) -> float:
    if math.isnan(value):
        msg = (
            "nan is no number: leave the key out, or write inf or -inf where an axis has no limit"
        )
        raise ValueError(msg)
    return value


Coordinate = Annotated[float, AfterValidator(_no_nan)]
Corner = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]


class LimitsSection(Table):
    """Where answers may send the arm, base frame (docs/limits.md); a target's keys count before the cell's."""

    lowest_mm: Corner | None = Field(
        default=None,
        description="corner x y z of a box for flange and tip, -inf where an axis has none; none: no such limit",
    )
    highest_mm: Corner | None = Field(
        default=None, description="its other corner, inf where an axis has none"
    )
    inner_radius_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        default=None, description="flange and tip are no nearer to the base's z axis; none: 0"
    )
    outer_radius_mm: Positive | None = Field(
        default=None, description="and no farther from it; none: no such limit"
    )
    volume_margin_mm: Positive | None = Field(
        default=None,
        description="the tip is no farther from where its target can be as the object moves; "
        f"none: {MARGIN_MM:g}",
    )
    cone_deg: Annotated[float, Field(gt=0, le=180)] | None = Field(
        default=None,
        description="the tool leans no farther from the taught approach; "
        f"none: {math.degrees(CONE_RAD):.0f}",
    )
    step_mm: Positive | None = Field(
        default=None, description="the flange is no farther from where it was taught; none: any"
    )
    step_deg: Annotated[float, Field(gt=0, le=180)] | None = Field(
        default=None,
        description="the wrist is turned no farther from how it was taught; none: any",
    )

    @model_validator(mode="after")
    def _some_room(self) -> Self:
        if self.lowest_mm is not None and self.highest_mm is not None:
            pairs = zip("xyz", self.lowest_mm, self.highest_mm, strict=True)
            crossed = [axis for axis, low, high in pairs if not low < high]
            if crossed:
                msg = f"lowest_mm is not below highest_mm in {', '.join(crossed)}: exchange them"
                raise ValueError(msg)
        if self.outer_radius_mm is not None and self.outer_radius_mm <= (
            self.inner_radius_mm or 0
        ):
            msg = "inner_radius_mm is not below outer_radius_mm: exchange them"
            raise ValueError(msg)
        return self
