"""The links between robot and object that one picture rests on, and which of them may have moved."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np

from vgrd.errors import TagNotSeen
from vgrd.geometry import Array, Pose
from vgrd.model.arrays import frozen_array
from vgrd.model.cell import Stability
from vgrd.model.session import Observation, TagObservation


def _exact() -> Array:
    return frozen_array(np.zeros(6), 6)


@dataclass(frozen=True, slots=True, eq=False)
class FlangeTag:
    """Tag A in a picture, and the flange pose of the same instant, the arm at rest."""

    tag: TagObservation
    base_from_wrist: Pose

    @classmethod
    def of(cls, picture: Observation) -> "FlangeTag | None":
        """Of a picture; None where it does not show tag A."""
        return None if picture.tag_a is None else cls(picture.tag_a, picture.base_from_wrist)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """How far the camera may stand from where it stood while teaching, and what measures it.

    stability: (6,) sigmas (mm, rad) of its displacement in its own frame; 0: it stands exactly where it
    stood, infinite: anywhere. flange_tag: None where tag A is hidden or the arm moves; is_recalled: it
    is that of an earlier picture.
    """

    stability: Array = field(default_factory=_exact)
    flange_tag: FlangeTag | None = None
    is_recalled: bool = False

    @property
    def is_exact(self) -> bool:
        """Whether it is taken to stand exactly where it stood."""
        return not self.stability.any()

    @property
    def is_free(self) -> bool:
        """Whether it may stand anywhere: a camera that is moved between requests."""
        return bool(np.isinf(self.stability).all())

    @property
    def is_believed(self) -> bool:
        """Whether this very picture leaves open where it stands: its stability is taken on trust."""
        return not self.is_exact and (self.flange_tag is None or self.is_recalled)

    def check_known(self) -> None:
        """TagNotSeen where it may stand anywhere although tag A, that would tell, is not used."""
        if self.is_free:
            raise TagNotSeen(
                "where the camera stands is not known: bring tag A into view and let the arm stand"
            )


UNMOVED = CameraPlace()


@dataclass(frozen=True, slots=True)
class Instant:
    """When a picture was taken, and since when the arm rested.

    shows_tag_a: tag A is in this very picture, the arm at rest.
    """

    stamp_s: float
    rest_since_s: float | None
    shows_tag_a: bool


def place_in(picture: Observation, stability: Stability) -> CameraPlace:
    """Where the camera may stand in a picture of the session that taught it."""
    if stability is Stability.FIXED:
        return UNMOVED
    return CameraPlace(frozen_array(np.full(6, np.inf), 6), FlangeTag.of(picture))


class Link(StrEnum):
    """What may have moved since teaching."""

    CAMERA = "camera"
    TAG_A = "tag A"
    TAG_B = "tag B"
    OBJECT = "object"


@dataclass(frozen=True, slots=True, eq=False)
class LinkReport:
    """What a picture says of its links.

    fits: the picture is as the calibration predicts, chance and the camera's displacement allowed for;
    misfit: the squares, in sigmas, that say so, of `freedom` degrees of freedom.
    taught_from_camera: how the camera seems to stand against where it stood while teaching, None where
    it is taken to stand still; knocked: farther off than its stability explains. suspects: links one
    of which must have moved, most likely first; slips: by link, how far it would have moved, (mm, rad).
    lasting: many pictures say so together, and a person must see to it.
    """

    fits: bool
    misfit: float
    taught_from_camera: Pose | None = None
    knocked: bool = False
    suspects: tuple[Link, ...] = ()
    slips: Mapping[Link, tuple[float, float]] = field(default_factory=dict)
    freedom: int = 0
    lasting: bool = False

    @property
    def size_mm(self) -> float:
        """How far the likeliest suspect moved; 0 where none is told."""
        return self.slips.get(self.suspects[0], (0.0, 0.0))[0] if self.suspects else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SlipEstimate:
    """How a tag slipped: tangent (6,) in its own frame, mm and rad, on the right; covariance (6, 6)."""

    link: Link
    tangent: Array
    covariance: Array

    @property
    def size_mm(self) -> float:
        """How far."""
        return float(np.linalg.norm(self.tangent[:3]))

    @property
    def size_rad(self) -> float:
        """How much it turned."""
        return float(np.linalg.norm(self.tangent[3:]))


@dataclass(frozen=True, slots=True)
class AdoptedSlip:
    """A slip that a person took over, until `term_unix_s` (infinite once a touch has borne it out).

    calibration: id of the one that it was added to; by: who did it.
    """

    link: Link
    size_mm: float
    size_rad: float
    calibration: str
    by: str
    adopted_unix_s: float
    term_unix_s: float


class PictureSeries(Protocol):
    """Judges pictures in their order, since the calibration was activated."""

    def see(self, tag_b: TagObservation, camera: CameraPlace, instant: Instant) -> LinkReport:
        """What a picture says after all earlier ones; raises TagNotSeen as the solution does."""

    def resume(self) -> str:
        """Judge anew after a slip that lasted; why not, in words, while it is still there."""

    def slip(self, link: Link) -> SlipEstimate:
        """How the link slipped; InputError where the pictures do not tell."""
