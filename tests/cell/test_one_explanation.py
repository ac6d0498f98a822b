"""A mistake in a session is named once, in the same words by `advise` and `solve`, with the numbers to undo."""

from dataclasses import replace

import pytest

from fakes.testing import ManualClock
from fakes.world.simulation import WORK_ROTATION, Simulation
from vgrd.calibration.solve import calibrate_system
from vgrd.errors import CalibrationError
from vgrd.judging.findings import FOLLOWING
from vgrd.model import Plan, Policy, Recording
from vgrd.solving.advisor import advise_folder
from vgrd.solving.session import solve_session
from vgrd.store.sessions import SampleKind, SessionWriter


def exchanged(*wrists, looks=4, spins=3) -> Recording:
    """Touches 1 and 2 have each other's names."""
    cell = Simulation(6)
    cell.put_uneven_part()
    recording = cell.record(looks=looks, spins=spins, wrists=wrists)
    first, second, *others = recording.touches
    touches = (replace(first, target="P2"), replace(second, target="P1"), *others)
    return replace(recording, touches=touches)


def stored(folder, recording: Recording):
    """A session whose samples are numbered spins, looks, touches."""
    with SessionWriter(folder, "s", Plan.JOINT, recording.facts, ManualClock()) as writer:
        for spin in recording.spins:
            writer.sample(SampleKind.SPIN, spin)
        for look in recording.looks:
            writer.sample(SampleKind.LOOK, look)
        for touch in recording.touches:
            writer.sample(SampleKind.TOUCH, touch)
    return writer.path


def solved(folder) -> tuple[str, set[str]]:
    """What is told against the samples, and the codes of the findings."""
    try:
        verdict = solve_session(folder)["verdict"]
    except CalibrationError as err:
        return str(err), set()
    assert not verdict["ok"]
    (fatal,) = [one for one in verdict["findings"] if one["fatal"]]
    return fatal["message"], {one["code"] for one in verdict["findings"]}


def tilted() -> list:
    cell = Simulation(1)
    return [cell.wrist(0.4) for _ in range(6)]


@pytest.mark.parametrize("wrists", [[WORK_ROTATION] * 6, tilted()])
def test_solve_and_advise_name_the_mistake_alone_and_what_to_undo(tmp_path, wrists):
    folder = stored(tmp_path, exchanged(*wrists))
    advice = advise_folder(folder, Policy.FIXED)
    words, codes = solved(folder)
    assert "are swapped" in words
    assert "1 (P2, sample 8)" in words
    assert "2 (P1, sample 9)" in words
    assert words in advice["trouble"]
    assert advice["next"] is None
    told = {one["code"] for one in advice["findings"]}
    assert "targets_swapped" in told
    assert not (told | codes) & FOLLOWING
    assert "file" not in words


def test_what_is_only_missing_is_told_as_before():
    recording = exchanged(WORK_ROTATION, WORK_ROTATION, WORK_ROTATION)
    with pytest.raises(CalibrationError, match="touch"):
        calibrate_system(replace(recording, touches=recording.touches[:2]))
