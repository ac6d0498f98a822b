"""Names for spaces of slips: along the arc, in the plane, in any direction."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vgrd.geometry import Array, Pose

UNITS = np.array([1.0] * 3 + [4e-3] * 3)  # mm, rad: alike over a tag, as slips of `joint/links`
_ALIKE = 0.02  # of a unit slip: a picture with noise gives 1e-3, another space 0.1 or more


class Course(StrEnum):
    """Where a slip leads; the arc is that about the axis of turning, the plane is turned in too."""

    NONE = "in no direction"
    ARC = "along the arc"
    PLANE = "in the plane"
    ANY = "in any direction"
    SOME = "in some directions"


_TWISTS: Mapping[Course, tuple[int, ...]] = {  # about the axis of turning, z of its frame
    Course.NONE: (),
    Course.ARC: (5,),
    Course.PLANE: (0, 1, 5),
    Course.ANY: (0, 1, 2, 3, 4, 5),
}


@dataclass(frozen=True, slots=True, eq=False)
class Slips:
    """A space of slips of a link in its own frame; basis: (6, k), orthonormal columns (mm, rad)."""

    basis: Array
    course: Course

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self.basis.size > 0


def slips_of(basis: Array, axis_from_link: Pose) -> Slips:
    """The space that columns (6, k) span, with its name."""
    basis = orthonormal(basis)
    twists = orthonormal((axis_from_link.adjoint() @ basis) / UNITS[:, None])
    for course, rows in _TWISTS.items():
        if len(rows) != basis.shape[1]:
            continue
        if float(np.abs(np.delete(twists, rows, axis=0)).max(initial=0.0)) < _ALIKE:
            return Slips(basis, course)
    return Slips(basis, Course.SOME)


def orthonormal(columns: Array) -> Array:
    """Another basis (n, k) of what independent columns (n, k) span."""
    return np.asarray(np.linalg.qr(columns)[0])
