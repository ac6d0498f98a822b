"""Operation `difference`: two calibrations, or one and that in use, for the picture of now."""

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.control.views import Views
from vgrd.cell.measuring import Sight
from vgrd.devices import CameraImage
from vgrd.errors import ControlError, InputError
from vgrd.model import Plan, Policy
from vgrd.store.calibrations import CalibrationStore


@pytest.fixture(scope="module")
def cell(tmp_path_factory) -> Any:
    """Two calibrations of one cell, from other touches, and a picture of the object turned."""
    store = CalibrationStore(tmp_path_factory.mktemp("state"), ManualClock())
    sim = Simulation(3)
    wrists = [WORK_ROTATION] * 3 + [sim.wrist(np.radians(25)) for _ in range(3)]
    for _ in range(2):
        store.save(calibrate_system(sim.record(wrists=wrists, plan=Plan.JOINT, looks=0, spins=4)))
    seen = sim.touch("P2", WORK_ROTATION, 1.1).observation
    assert seen is not None
    picture = CameraImage(np.zeros((4, 4), np.uint8), 1.0, 1)
    sight = Sight(picture, seen.tag_a, seen.tag_b, seen.base_from_wrist, None)

    async def fresh(_: float) -> Sight:
        return sight

    return SimpleNamespace(store=store, measuring=SimpleNamespace(fresh=fresh, sight=sight))


def compared(cell: Any, active: Any, **arguments: str) -> dict[str, Any]:
    serving = SimpleNamespace(
        calibration=active,
        limits=SimpleNamespace(policy=Policy.FIXED),
        cameras=SimpleNamespace(stability=np.zeros(6)),
    )
    views: Any = Views(
        cell.measuring,
        serving,
        None,
        SimpleNamespace(store=cell.store),
        None,
        ManualClock(),  # type: ignore[arg-type]
    )
    return dict(asyncio.run(views.table()["difference"].perform(arguments)))


def test_one_that_is_compared_with_itself_does_not_differ(cell):
    told = compared(cell, None, calibration="cal-000001", **{"with": "cal-000001"})
    assert {one["mm"] for one in told["targets"].values()} == {0.0}


def test_the_difference_is_the_same_either_way_and_of_the_size_of_the_touches(cell):
    one = compared(cell, None, calibration="cal-000001", **{"with": "cal-000002"})
    other = compared(cell, None, calibration="cal-000002", **{"with": "cal-000001"})
    assert one["with"] == other["calibration"] == "cal-000002"
    for name, apart in one["targets"].items():
        assert apart["mm"] == pytest.approx(other["targets"][name]["mm"])
        assert 0.001 < apart["mm"] < 1.5


def test_without_another_it_is_the_one_in_use(cell):
    active = cell.store.load("cal-000002")
    assert compared(cell, active, calibration="cal-000001")["with"] == "cal-000002"
    with pytest.raises(ControlError, match="nothing to compare"):
        compared(cell, None, calibration="cal-000001")


def test_one_that_is_not_there_is_named(cell):
    with pytest.raises(InputError, match="cal-000009"):
        compared(cell, None, calibration="cal-000009", **{"with": "cal-000001"})
