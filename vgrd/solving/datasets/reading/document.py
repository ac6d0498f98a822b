"""The tables of DATASET.toml that tell of the camera, the poses, the features and the samples."""

from typing import Annotated

from pydantic import BeforeValidator, Field

from vgrd.documents.tables import NamedTable, Number, Table
from vgrd.geometry.pose_formats import MATRIX
from vgrd.solving.flange_poses import Numbers, PoseFormat, Unit, flat

Vector = Annotated[list[Number], Field(min_length=3, max_length=3), BeforeValidator(flat)]

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


class TcpTable(Table):
    """The point of the tool that samples with a point show, in the wrist, mm."""

    tcp_in_wrist: Vector


class CameraPosesTable(Table):
    """How the camera's side is written; unit: as of the flange poses where it is left out."""

    unit: Unit | None = None
    rotation: PoseFormat = MATRIX


class SamplesTable(Table):
    """Samples in a table of columns, and pictures or points files in natural order.

    Each key names the column, or the columns in order, that hold what a sample's key of that name does.
    """

    table: str | None = None
    name: str | None = None
    pose: str | list[str] | None = None
    camera_from_target: str | list[str] | None = None
    rvec: str | list[str] | None = None
    tvec: str | list[str] | None = None
    point_in_camera: str | list[str] | None = None
    image: str | None = None
    images: str | None = None
    points: str | None = None


class SampleTable(NamedTable):
    """One sample: the flange's pose in the base, and what the camera saw; features: pixels by name.

    rvec, tvec: OpenCV's pose of the target in the camera; point_in_camera: a point of the tool there.
    """

    pose: Numbers
    image: str | None = None
    points: str | None = None
    camera_from_target: Numbers | None = None
    rvec: Vector | None = None
    tvec: Vector | None = None
    point_in_camera: Vector | None = None
    features: dict[str, Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        default={}
    )
