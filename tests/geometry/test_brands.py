"""A pose as a robot brand writes it: check values, numbers that read back, the page of all brands."""

import re
from pathlib import Path

import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.brands import BRANDS, brand_form, document
from vgrd.geometry.rotation_formats import pose_from

POSE = Pose.from_rotvec((1.1, -2.2, 0.5), (400.0, -20.5, 308.0))
CONFIGURATION = 10  # numbers of a robtarget behind its pose


@pytest.mark.parametrize(
    ("brand", "numbers"),
    [  # the same orientation, by another implementation
        ("ur", (1.1, -2.2, 0.5)),
        ("kuka", (-128.586, -42.477, -175.587)),
        ("fanuc", (-175.587, -42.477, -128.586)),
        ("yaskawa", (-175.587, -42.477, -128.586)),
        ("doosan", (-122.066, 137.338, -175.196)),
        ("kawasaki", (-122.066, 137.338, -175.196)),
        ("epson", (-128.586, -42.477, -175.587)),
    ],
)
def test_check_values(brand: str, numbers: tuple[float, ...]) -> None:
    assert _numbers(BRANDS[brand].write(POSE))[3:6] == pytest.approx(numbers, abs=1e-3)


@pytest.mark.parametrize("brand", BRANDS)
def test_what_is_written_means_the_pose(brand: str) -> None:
    form = BRANDS[brand]
    rng = np.random.default_rng(2)
    for _ in range(20):
        pose = Pose.from_rotvec(rng.uniform(-1.8, 1.8, 3), rng.uniform(-500, 500, 3))
        numbers = _numbers(form.write(pose))
        if brand == "abb":
            numbers = numbers[:-CONFIGURATION]
        mm, rad = pose_from(numbers, form.rotation, form.unit).distance(pose)
        assert mm < 2e-3
        assert rad < 1e-5


def test_ur_is_told_near_to_the_taught_wrist() -> None:
    down = Pose.from_rotvec((np.pi - 1e-9, 0, 0), (0, 0, 0))
    there = _numbers(BRANDS["ur"].write(down, (np.pi, 0, 0)))
    back = _numbers(BRANDS["ur"].write(down, (-np.pi, 0, 0)))
    assert there[3] == pytest.approx(np.pi, abs=1e-5)
    assert back[3] == pytest.approx(-np.pi, abs=1e-5)


def test_abb_has_its_scalar_first() -> None:
    text = BRANDS["abb"].write(Pose.from_rotvec((0, 0, 0), (1, 2, 3)))
    assert text.startswith("[[1.000, 2.000, 3.000], [1.000000, 0.000000, 0.000000, 0.000000]")


def test_an_unknown_brand_is_told_which_there_are() -> None:
    assert brand_form("KUKA") is BRANDS["kuka"]
    with pytest.raises(InputError, match="abb, doosan"):
        brand_form("kukka")


def test_the_page_is_what_the_table_says() -> None:
    page = Path(__file__).parents[2] / "docs" / "poses.md"
    assert page.read_text(encoding="utf-8") == document()


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"(?<![A-Za-z])-?\d+(?:\.\d+)?(?:E\d+)?", text)]
