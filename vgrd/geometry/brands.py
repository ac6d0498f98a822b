"""A pose as the controller of a robot brand writes it; `python -m vgrd.geometry.brands docs/poses.md` lists all.

Sources as `rotation_formats`; the spelling is that of each brand's own programs.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from vgrd.errors import InputError
from vgrd.geometry.pose import Pose
from vgrd.geometry.pose_formats import MM_PER
from vgrd.geometry.rotation_formats import RotationFormat, rotation_from, rotation_to, rotvec_near


@dataclass(frozen=True, slots=True)
class BrandForm:
    """How a brand writes a pose. text: with a place for each number, in the order of the rotation format."""

    rotation: RotationFormat
    unit: str
    text: str
    remark: str = ""

    def write(self, pose: Pose, near: ArrayLike = (0.0, 0.0, 0.0)) -> str:
        """The pose; near: (3,) the rotation vector, rad, near to which one is written."""
        if self.rotation is RotationFormat.ROTVEC:
            numbers = rotvec_near(pose.rotation, near)
        else:
            numbers = rotation_to(pose.rotation, self.rotation)
        place = pose.translation / MM_PER[self.unit]
        return self.text.format(*place, *numbers)


_MM = "{:.3f}, {:.3f}, {:.3f}"
_RPY = BrandForm(
    RotationFormat.RPY_FIXED_XYZ_DEG,
    "mm",
    "X {:.3f}  Y {:.3f}  Z {:.3f}  RX {:.4f}  RY {:.4f}  RZ {:.4f}",
    "roll, pitch, yaw about the fixed axes X, Y, Z",
)
BRANDS: Final[Mapping[str, BrandForm]] = MappingProxyType(
    {
        "abb": BrandForm(
            RotationFormat.ABB_QUATERNION_WXYZ,
            "mm",
            "[[" + _MM + "], [{:.6f}, {:.6f}, {:.6f}, {:.6f}], [0, 0, 0, 0], "
            "[9E9, 9E9, 9E9, 9E9, 9E9, 9E9]]",
            "robtarget, quaternion w first; take the configuration from the taught one, move with tool0",
        ),
        "doosan": BrandForm(
            RotationFormat.ZYZ_DEG,
            "mm",
            "posx(" + _MM + ", {:.4f}, {:.4f}, {:.4f})",
            "A, B, C are Euler Z, Y', Z''",
        ),
        "epson": BrandForm(
            RotationFormat.EPSON_UVW_DEG,
            "mm",
            "XY(" + _MM + ", {:.4f}, {:.4f}, {:.4f})",
            "U, V, W are turns about Z, Y', X''; Tool 0",
        ),
        "fanuc": BrandForm(
            RotationFormat.FANUC_WPR_DEG,
            "mm",
            "X {:.3f}  Y {:.3f}  Z {:.3f}  W {:.4f}  P {:.4f}  R {:.4f}",
            "UFRAME 0 and a UTOOL that is zero; take the configuration from the taught one",
        ),
        "jaka": _RPY,
        "kawasaki": BrandForm(
            RotationFormat.KAWASAKI_OAT_DEG,
            "mm",
            "TRANS(" + _MM + ", {:.4f}, {:.4f}, {:.4f})",
            "O, A, T are Euler Z, Y', Z''",
        ),
        "kuka": BrandForm(
            RotationFormat.KUKA_ABC_DEG,
            "mm",
            "{{X {:.3f}, Y {:.3f}, Z {:.3f}, A {:.4f}, B {:.4f}, C {:.4f}}}",
            "$BASE and $TOOL zero; take S and T from the taught one",
        ),
        "staubli": BrandForm(
            RotationFormat.STAUBLI_RXRYRZ_DEG,
            "mm",
            "{{" + _MM + ", {:.4f}, {:.4f}, {:.4f}}}",
            "trsf of VAL3: turns about X, Y', Z''; tool flange",
        ),
        "techman": _RPY,
        "ur": BrandForm(
            RotationFormat.ROTVEC,
            "m",
            "p[{:.6f}, {:.6f}, {:.6f}, {:.6f}, {:.6f}, {:.6f}]",
            "m and rad; move with TCP 0, or with pose_trans(this, get_tcp_offset())",
        ),
        "xarm": _RPY,
        "yaskawa": BrandForm(
            RotationFormat.YASKAWA_RXRYRZ_DEG,
            "mm",
            "X {:.3f}  Y {:.3f}  Z {:.3f}  Rx {:.4f}  Ry {:.4f}  Rz {:.4f}",
            "robot frame, tool zero",
        ),
    }
)


def brand_form(brand: str) -> BrandForm:
    """Of a brand, whatever its letters' case; InputError lists those that there are."""
    form = BRANDS.get(brand.lower())
    if form is None:
        raise InputError(f"brand {brand!r} is not known; there are: {', '.join(BRANDS)}")
    return form


_EXAMPLE = Pose(
    rotation_from((1.1, -2.2, 0.5), RotationFormat.ROTVEC), np.array([400, -20.5, 308])
)
_INTRODUCTION = """\
# Poses

Generated from `vgrd/geometry/brands.py` by `python -m vgrd.geometry.brands docs/poses.md`.

Every pose that vgrd tells a robot or a person is named `target_from_source`. The expected coordinate is
`base_from_wrist`: **the flange in the robot's base**. It is not the TCP that is active on the pendant: vgrd
calibrates its own and does not rest on that one. Who types the six numbers into a move of an active TCP is off
by the length of that TCP. Either the tool of the move is zero, or the program converts (UR:
`pose_trans(ec, get_tcp_offset())`). Registers and lines can tell the touch tip instead (OPT b1).

`vgrd ec P1 --for BRAND` writes the pose as the brand does. One pose in all forms, flange at (400, -20.5, 308) mm,
rotation vector (1.1, -2.2, 0.5) rad:

"""
_ENDING = """
A rotation vector has two writings of one orientation wherever a wrist stands by half a turn, and tools that point
down do: (3.14, 0, 0) and (-3.14, 0, 0). Of all that mean the orientation vgrd writes the one nearest to how the
target was taught, in registers, lines and `vgrd ec` alike; the first taught target (lowest id) decides the side for
all. So noise flips no sign, and a taught box may hold RX, RY and RZ. A vector may be a little longer than pi for it.
Nothing is nearest half a turn away from the taught orientation: a wrist that follows its object flips there.
Angles (RPY, A B C, W P R) lie within -180 to 180 degrees; compare them modulo 360.
"""


def document() -> str:
    """The text of docs/poses.md."""
    rows = [
        f"| {name} | `{form.write(_EXAMPLE)}` | {form.unit} | {form.remark} |"
        for name, form in BRANDS.items()
    ]
    head = ["| brand | pose | lengths | note |", "| --- | --- | --- | --- |"]
    return _INTRODUCTION + "\n".join(head + rows) + "\n" + _ENDING


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")
