"""Numbers that several sections of the cell file have."""

from typing import Annotated

from pydantic import Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
