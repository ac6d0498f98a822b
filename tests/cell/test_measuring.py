"""A press of a button is about now: readings from before it never answer it."""

import asyncio
from collections.abc import Mapping
from pathlib import Path

import pytest

from fakes.samples import Samples
from fakes.testing import ManualClock
from vgrd.cell.measuring import Measuring
from vgrd.devices import FlangeReading, Pixels
from vgrd.errors import NotSteady
from vgrd.geometry import Pose
from vgrd.model import TagObservation

PERIOD_S = 0.008


class Blind:
    """A detector that never finds anything."""

    def detect(
        self, pixels: Pixels, around: Mapping[int, TagObservation] | None = None
    ) -> dict[int, TagObservation]:
        return {}


def at(stamp_s: float, x_mm: float) -> FlangeReading:
    return FlangeReading(Pose.from_rotvec((0, 0, 0), (x_mm, 0, 0)), None, stamp_s, stamp_s)


@pytest.fixture
def measuring(tmp_path: Path) -> Measuring:
    clock = ManualClock(1000.0)
    return Measuring(tmp_path, Blind(), Samples(0).facts(), clock, 1.0)


def test_the_pose_of_a_press_comes_from_readings_after_it(measuring: Measuring) -> None:
    measuring.robot.readings.extend(at(999.5 + PERIOD_S * k, 0.0) for k in range(60))

    async def press() -> Pose:
        pressed = asyncio.create_task(measuring.rest())
        await asyncio.sleep(0.02)
        assert not pressed.done()
        measuring.robot.readings.extend(at(1000.0 + PERIOD_S * k, 5.0) for k in range(10))
        return await pressed

    assert asyncio.run(press()).translation[0] == 5.0


def test_an_arm_that_goes_on_moving_is_not_steady(measuring: Measuring) -> None:
    measuring.robot.readings.extend(at(999.9 + PERIOD_S * k, 0.1 * k) for k in range(100))
    with pytest.raises(NotSteady):
        asyncio.run(measuring.rest())
