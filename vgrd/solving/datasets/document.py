"""The tables of DATASET.toml that tell of the camera, the poses, the features and the samples."""

from typing import Annotated

from pydantic import Field

from vgrd.documents.tables import NamedTable, Number, Table

SizePx = Annotated[int, Field(ge=1, le=100_000)]  # wider than any sensor: a slip


class CameraTable(Table):
    """Intrinsics in px: matrix fx fy cx cy, distortion in OpenCV's order; or the camera file that holds them.

    size_px: (width, height) of the pictures; name: of the camera, where the file holds several; refine:
    estimate the intrinsics too.
    """

    matrix: Annotated[list[Number], Field(min_length=4, max_length=4)] | None = None
    distortion: list[Number] | None = None
    size_px: Annotated[list[SizePx], Field(min_length=2, max_length=2)] | None = None
    file: str | None = None
    name: str | None = None
    refine: bool = False


class FeatureTable(NamedTable):
    """A point that is fixed to the target, such as a hole.

    point_mm: its place there, where known; sigma_mm: how well, per axis.
    """

    point_mm: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    sigma_mm: Annotated[
        float,
        Field(ge=1e-3, le=100, allow_inf_nan=False),  # finer is no part; coarser says nothing
    ] = 0.1  # a guess: a place that was measured by hand


class SampleTable(NamedTable):
    """One sample: the flange's pose in the base, and what the camera saw; features: pixels by name."""

    pose: list[Number]
    image: str | None = None
    points: str | None = None
    camera_from_target: Annotated[list[Number], Field(min_length=16, max_length=16)] | None = None
    features: dict[str, Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        default={}
    )
