"""The cell file: TOML in, checked and frozen values out; all faults in one message.

Units are part of the keys, so a key with the wrong unit is an unknown key and named as one.
Used at the file edge only; `vgrd.config.setup` turns it into the values of `vgrd.model`.
"""

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from vgrd.config.cell_values import Matrix, Network, Settings, no_wrist
from vgrd.config.limits_section import LimitsSection
from vgrd.config.metrics_section import MetricsSection
from vgrd.config.page_section import PageSection
from vgrd.config.quantities import Finite, Name, Positive, Vector
from vgrd.documents.tables import FaultAt, Table, located_faults
from vgrd.documents.toml import hint, read_with_places
from vgrd.documents.toml_lines import KeyPlaces, Location
from vgrd.errors import ConfigError
from vgrd.geometry.camera import implausible_matrix
from vgrd.geometry.coincidence import are_in_line
from vgrd.judging.thresholds import LINE
from vgrd.model.cell import SMALLEST_TAG_MM

_hint = partial(hint, list_name="known here", alike=0.5)  # another unit shares few letters


class CellSection(Table):
    """Who this is and where files go; relative paths count from the cell file's folder."""

    name: Name
    state_dir: str = Field(
        default="", description="sessions and calibrations; $STATE_DIRECTORY, /var/lib/vgrd"
    )
    runtime_dir: str = Field(
        default="", description="rings and socket; $RUNTIME_DIRECTORY, /run/vgrd"
    )
    group: str = Field(
        default="",
        pattern=r"^([A-Za-z0-9_][A-Za-z0-9_.-]{0,31})?$",
        description="its members may use the control socket and read the files; none: as the unit says",
    )
    simulation: bool = Field(default=False, description="tells the robot so (STATE bit 15)")


class RobotSection(Table):
    """The robot: driver module, its settings, and how much its arm is to be trusted."""

    driver: str
    id: str = ""
    sigma_mm: Positive = Field(  # a guess: 0.03 mm of it repeat, the rest is absolute
        default=0.1, description="what its absolute position is good for, 1 sigma"
    )
    settings: Settings = Field(default={})


class CameraSection(Table):
    """The camera: driver, mounting, intrinsics in pixels (fx fy cx cy; distortion in OpenCV order)."""

    driver: str
    id: str = ""
    mount: Annotated[Literal["eye-to-hand"], no_wrist] = "eye-to-hand"
    rate_hz: float = Field(  # a guess: whole ones take 0.1 s (decision 7), a fifth of the time
        default=2.0, gt=0, le=60, description="pictures taken unasked, to watch the cell"
    )
    watch_rate_hz: float = Field(  # a region takes 0.03 s (decision 7); a slower one has room
        default=10.0,
        gt=0,
        le=60,
        description="pictures of tag B (a region, where the camera sends one) while an answer stands",
    )
    stability: Literal["fixed", "movable"] = Field(
        default="fixed",
        description="fixed: it stays where it was while teaching; movable: people move it, while teaching too "
        "(plan joint), and tag A tells where it is",
    )
    stability_mm: Positive = Field(  # a guess: brackets of steel sag and warm up by less
        default=0.5, description="fixed: how far it may have moved since, 1 sigma per axis"
    )
    stability_mrad: Positive = Field(  # the same at 1 m
        default=0.5, description="fixed: how far it may have turned since, 1 sigma per axis"
    )
    delay_ms: float = Field(  # `timing.offset` looks for no more than that
        default=0.0,
        ge=0,  # stamps that come late would make pictures look younger than they are
        le=250,
        description="pictures were taken so much after their stamps, by the robot's clock: `vgrd solve` tells it",
    )
    bits: Literal[8, 16] = Field(  # 16 take twice the link
        default=8, description="of a pixel: 16 for Mono10 to Mono16"
    )
    matrix: Matrix
    distortion: Annotated[list[Finite], Field(max_length=8)] = Field(default=[])
    size_px: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=2, max_length=2)]
    settings: Settings = Field(default={})

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        fx, fy, cx, cy = self.matrix
        width, height = self.size_px
        if not (fx > 0 and fy > 0 and 0 < cx < width and 0 < cy < height):
            msg = "is fx, fy, cx, cy in pixels: focal lengths positive, principal point inside size_px"
            raise FaultAt(msg, "matrix")
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        fault = implausible_matrix(K, (width, height))
        if fault is not None:
            raise FaultAt(fault, "matrix")
        if len(self.distortion) not in (0, 4, 5, 8):
            msg = (
                f"has {len(self.distortion)} coefficients: give 0, 4, 5 or 8 of them, k1 k2 p1 p2 [k3 "
                "[k4 k5 k6]] (OpenCV's order)"
            )
            raise FaultAt(msg, "distortion")
        return self


class TagSection(Table):
    """A fiducial: AprilTag family, id, edge of the black square in mm."""

    family: Literal["36h11", "25h9", "16h5"] = "36h11"
    id: Annotated[int, Field(ge=0)]
    size_mm: Annotated[float, Field(ge=SMALLEST_TAG_MM, le=1000)]
    size_sigma_mm: Annotated[float, Field(ge=0, le=10)] = Field(
        default=0.05,  # a caliper's: printers are off by more, along the paper most
        description="how well size_mm is known, 1 sigma, along and across the paper each; 0: exactly",
    )


class TagsSection(Table):
    """Tag A on the flange, tag B on the object."""

    a: TagSection
    b: TagSection

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        if self.a.id == self.b.id:  # what is seen is known by id alone, whatever the family
            msg = (
                "tags a and b must differ in id, whatever their families: "
                "the daemon could not tell them apart"
            )
            raise FaultAt(msg, "b", "id")
        return self


class ToolSection(Table):
    """The tool: direction out of its tip in the flange frame, offset from touching to working tip."""

    name: str = "tool"
    axis: Vector = Field(default=[0.0, 0.0, 1.0], description="out of the tip, flange frame")
    work_offset_mm: Vector = Field(
        default=[0.0, 0.0, 0.0],
        description="from the tip that touches to the tip that works, flange frame",
    )

    @model_validator(mode="after")
    def _direction(self) -> Self:
        if sum(x * x for x in self.axis) < 1e-6:
            msg = "is a direction and cannot be zero: [0, 0, 1] for a tool along the flange's z"
            raise FaultAt(msg, "axis")
        return self


class TargetSection(Table):
    """A point of the object to be reached: register id, name, CAD coordinates where there are any."""

    id: Annotated[int, Field(ge=1, le=65535)]
    name: Name
    point_mm: Vector | None = Field(
        default=None, description="CAD coordinates; none: touches of the target tell where it is"
    )
    work_rotvec_deg: Vector | None = Field(
        default=None,
        description="wrist orientation for the work, object as taught; none: as touched",
    )
    hole_diameter_mm: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None,
        description="of the hole that the point is the centre of, at its rim: pictures then measure it",
    )
    clearance_mm: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None,
        description="diameter of the hole minus that of what goes in: how often it goes in is then told",
    )
    limits: LimitsSection = LimitsSection()

    @model_validator(mode="after")
    def _hole_in_cad(self) -> Self:
        if self.hole_diameter_mm is not None and self.point_mm is None:
            msg = (
                "hole_diameter_mm needs point_mm: pictures are searched where CAD puts the hole; "
                "give point_mm, or leave hole_diameter_mm out and touch the target"
            )
            raise FaultAt(msg, "hole_diameter_mm")
        return self


class ObjectSection(Table):
    """The object: how it moves, its centre of rotation in CAD, its targets."""

    motion: Literal["turntable", "planar", "free"] = "turntable"
    center_mm: Vector | None = Field(
        default=None, description="a point of the turntable's axis, CAD"
    )
    hole_sigma_mm: Positive = Field(
        default=0.03,  # a guess: a milled hole is within 0.1 mm, which is 3 sigma
        description="how well the part's holes are where CAD says, 1 sigma per coordinate",
    )
    center_sigma_mm: Positive = Field(
        default=0.2,  # a guess: a plate on a used turntable, not measured; 0.02 where it was
        description="how well center_mm is known across the axis, 1 sigma per coordinate",
    )
    cad_sigma_mm: Annotated[float, Field(ge=0, le=100)] = Field(
        default=0.03,  # as `hole_sigma_mm`: what is milled is within 0.1 mm, which is 3 sigma
        description="how well the part's targets are where point_mm says, 1 sigma per coordinate; 0: exactly",
    )
    targets: Annotated[list[TargetSection], Field(min_length=1)]

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        for what in ("id", "name"):
            values = [getattr(target, what) for target in self.targets]
            for i, value in enumerate(values):
                if value in values[:i]:
                    msg = f"targets share the {what} {value}: each needs its own"
                    raise FaultAt(msg, "targets", i, what)
        return self

    @model_validator(mode="after")
    def _frame_in_cad(self) -> Self:
        points = [target.point_mm for target in self.targets if target.point_mm is not None]
        bare = [target.name for target in self.targets if target.point_mm is None]
        few = len(points) < 3  # the least of a rigid fit
        if points and bare and (few or are_in_line(np.array(points), LINE)):
            msg = (
                f"{', '.join(bare)} have no point_mm, and those of the others are fewer than three or on "
                "one line, so that they fix no frame: give point_mm of three targets that are not on one "
                "line, or of none"
            )
            index = next(i for i, one in enumerate(self.targets) if one.name == bare[0])
            raise FaultAt(msg, "targets", index)
        return self

    @model_validator(mode="after")
    def _center_in_cad(self) -> Self:
        if self.center_mm is not None and all(t.point_mm is None for t in self.targets):
            msg = (
                "center_mm is stated in the frame of the targets' point_mm, and no target has one: "
                "leave center_mm out, spins of the object tell where it turns"
            )
            raise FaultAt(msg, "center_mm")
        return self


class TouchSection(Table):
    """How well the operator touches: standard deviations across and along the tool axis."""

    lateral_sigma_mm: Positive = 0.25  # the paper's 0.233 mm, rounded up
    axial_sigma_mm: Annotated[float, Field(gt=0)] = 0.25  # as across: the paper tells one


class PedalSection(Table):
    """What records a touch of the next target when a foot presses it: a pedal, an input of the robot."""

    driver: str = Field(default="", description="`serial_pedal`, a pedal on a serial port")
    robot_input: Annotated[int, Field(ge=0, le=63)] | None = Field(
        default=None,
        description="number of a digital input of the robot (driver `ur_rtde` tells them)",
    )
    settings: Settings = Field(default={})


class RecordingSection(Table):
    """Sessions on the disk: how much they may take, and what must stay free."""

    quota_gb: Positive = Field(
        default=50.0,  # a guess: 10,000 pictures of 12 megapixels (5 MB each)
        description="all sessions; beyond it the oldest are removed, none that a calibration cites",
    )
    keep_free_gb: float = Field(  # a guess: room for logs and calibrations while it pauses
        default=1.0,
        ge=0,
        allow_inf_nan=False,
        description="recording pauses while less is free on the disk",
    )


class ServingSection(Table):
    """The registers: where, for whom, and what an answer must satisfy."""

    host: str = Field(default="127.0.0.1", description="address to listen at, one of this machine")
    port: int = Field(  # Modbus' own 502 and 1000: below 1024 it needs privileges
        default=1502, ge=1, le=65535, description="below 1024: with config/vgrd.socket"
    )
    line_port: int | None = Field(
        default=None,
        ge=1,
        le=65535,
        description="of the line server, for controllers without Modbus; without it there is none",
    )
    allow: list[Network] = Field(
        default=["127.0.0.1"], min_length=1, description="robots that may connect"
    )
    policy: Literal["fixed", "follow"] = Field(
        default="fixed", description="how the wrist will stand"
    )
    max_age_s: float = Field(  # a guess: time to set off; pictures end it sooner (decision 7)
        default=3.0, gt=0, le=60, description="an answer expires this long after its picture"
    )
    deadline_s: float = Field(  # as DEADLINE_S: a dozen of the images that come every 20 ms
        default=0.25, ge=0.05, le=1.0, description="a silent cell process is lost after this"
    )
    timeout_s: float = Field(  # as REQUEST_TIMEOUT_S: a device waits so long for a picture
        default=2.0, gt=0, le=60, description="a request without an answer ends with 106"
    )
    max_u95_mm: Positive = Field(  # a guess: four sigmas of a touch; jobs differ
        default=1.0, description="less certain answers are refused with 504"
    )
    warn_u95_mm: Positive = Field(  # half of `max_u95_mm`: told before answers are refused
        default=0.5, description="less certain answers are OK_DEGRADED"
    )
    moved_mm: Positive = Field(  # what pictures of a region tell from noise (decision 7)
        default=0.3, description="an object that moves farther ends the answer with 206"
    )
    hidden_tag: Literal["invalid", "hold"] = Field(
        default="invalid",
        description="an answer whose tag B is hidden: ends at once, or stands for hold_s near the target",
    )
    hold_s: float = Field(  # a guess: the last 60 mm at 60 mm/s, as `approach_mm`
        default=1.0, gt=0, le=10, description="hidden_tag hold: so long since tag B was seen"
    )
    approach_mm: Positive = Field(  # a guess: from here the arm goes straight to its target
        default=60.0,
        description="hidden_tag hold: only while the flange is so near to the coordinate",
    )
    int16_scale: Literal["mrad", "centidegree", "fine"] = Field(
        default="mrad",
        description="steps of the int16 registers: 0.1 mm and 1 mrad, 0.1 mm and 0.01 deg, or"
        " 0.05 mm and 0.1 mrad (no farther than 1.638 m from the base, rotation vectors up to 187 degrees)",
    )


_PORTS = (("serving", "line_port"), ("metrics", "port"), ("page", "port"))


class CellConfig(Table):
    """The whole file."""

    cell: CellSection
    robot: RobotSection
    camera: CameraSection
    tags: TagsSection
    tool: ToolSection = ToolSection()
    object: ObjectSection
    touch: TouchSection = TouchSection()
    pedal: PedalSection = PedalSection()
    recording: RecordingSection = RecordingSection()
    serving: ServingSection = ServingSection()
    limits: LimitsSection = LimitsSection()
    metrics: MetricsSection = MetricsSection()
    page: PageSection = PageSection()

    @model_validator(mode="after")
    def _ports_differ(self) -> Self:
        """Each server has a port of its own; on which address it listens is not looked at."""
        taken = {self.serving.port: "[serving] port"}
        for section, key in _PORTS:
            port = getattr(getattr(self, section), key)
            if port in taken:
                msg = f"{port} is {taken[port]} already: give this one another, such as {port + 1}"
                raise FaultAt(msg, section, key)
            if port is not None:
                taken[port] = f"[{section}] {key}"
        return self


class CellText(NamedTuple):
    """A cell file as it was read: its keys and their lines, and every fault by the place of its key."""

    places: KeyPlaces
    config: CellConfig | None
    faults: tuple[tuple[Location, str], ...]


def read_cell(path: Path) -> CellText:
    """Read a cell file; ConfigError where it cannot be read at all."""
    places = read_with_places(path, "a cell file, see config/")
    try:
        config = CellConfig.model_validate(places.data)
    except ValidationError as err:
        return CellText(places, None, tuple(located_faults(err, CellConfig, _hint)))
    folder = path.resolve().parent
    found = {"cell": with_folders(config.cell, folder), "page": config.page.with_files(folder)}
    return CellText(places, config.model_copy(update=found), ())


def load_config(path: Path) -> CellConfig:
    """Read and check a cell file; ConfigError holds every fault, each with line, key and remedy."""
    places, config, faults = read_cell(path)
    if config is None:
        raise ConfigError(str(path), [places.told(*fault) for fault in faults])
    return config


def with_folders(cell: CellSection, folder: Path) -> CellSection:
    """Fill in the folders, and resolve them from that of the file; systemd's variables are the defaults."""
    state = cell.state_dir or os.environ.get("STATE_DIRECTORY", "/var/lib/vgrd")
    runtime = cell.runtime_dir or os.environ.get("RUNTIME_DIRECTORY", "/run/vgrd")
    return cell.model_copy(
        update={"state_dir": str(folder / state), "runtime_dir": str(folder / runtime)}
    )
