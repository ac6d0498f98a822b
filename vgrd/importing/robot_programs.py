"""Poses in programs of robots: UR's p[...], KUKA's {X ..., A ...}, ABB's robtarget, as tables."""

import re

from vgrd.documents.sheets import Sheet

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_KUKA_AXES = ("X", "Y", "Z", "A", "B", "C")


def _list_of(count: int) -> str:
    return r"\s*" + r"\s*,\s*".join([_NUMBER] * count) + r"\s*"


_FORMS = (  # what it is, its pattern, names of its columns
    (
        "poses of a program of UR, p[...] in m with a rotation vector",
        re.compile(rf"\bp\[{_list_of(6)}\]"),
        (*(f"robot {axis} [m]" for axis in "xyz"), *(f"robot rotvec {i}" for i in range(3))),
    ),
    (
        "poses of a program of KUKA, {X ..., A ...} in mm and degrees",
        re.compile(r"\{\s*" + r"\s*,\s*".join(rf"{axis}\s+{_NUMBER}" for axis in _KUKA_AXES)),
        (*(f"robot {axis} [mm]" for axis in "xyz"), *(f"robot {angle} [deg]" for angle in "abc")),
    ),
    (
        "robtargets of ABB, in mm with a quaternion, the scalar first",
        re.compile(rf"\[\s*\[{_list_of(3)}\]\s*,\s*\[{_list_of(4)}\]\s*,"),
        (*(f"robot {axis} [mm]" for axis in "xyz"), *(f"robot q{i}" for i in range(1, 5))),
    ),
)


def program_sheet(text: str) -> tuple[str, Sheet] | None:
    """What the program is, and its poses in the order of its lines; None for other texts.

    A line with two poses is no list of poses: such a text is left to others.
    """
    for kind, pattern, names in _FORMS:
        rows = []
        for number, line in enumerate(text.splitlines(), 1):
            found = pattern.findall(line)
            if len(found) > 1:
                break
            rows += [(f"line {number}", [float(word) for word in found[0]])] if found else []
        else:
            if rows:
                cells = zip(*(values for _, values in rows), strict=True)
                columns = {name: list(column) for name, column in zip(names, cells, strict=True)}
                return kind, Sheet(columns, [place for place, _ in rows])
    return None
