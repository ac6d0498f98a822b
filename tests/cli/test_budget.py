"""`vgrd budget` and `vgrd advise` on a recorded session."""

import json
from pathlib import Path

import pytest

from fakes.testing import ManualClock
from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import Simulation
from vgrd.model import Plan
from vgrd.store.sessions import SampleKind, SessionWriter


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sim = Simulation(3, arm=ArmErrors(0.03, 0.1))
    wrists = [sim.wrist()] * 4 + [sim.wrist(0.4) for _ in range(3)]
    taught = sim.record(looks=4, spins=3, wrists=wrists)
    state = tmp_path_factory.mktemp("state")
    with SessionWriter(state, "one", Plan.JOINT, taught.facts, ManualClock()) as writer:
        for kind, samples in (
            (SampleKind.LOOK, taught.looks),
            (SampleKind.SPIN, taught.spins),
            (SampleKind.TOUCH, taught.touches),
        ):
            for sample in samples:
                writer.sample(kind, sample)
        return writer.path


def test_a_budget_is_a_table_a_file_and_a_picture(vgrd, session, tmp_path) -> None:
    png, out = tmp_path / "budget.png", tmp_path / "budget.json"
    done = vgrd("budget", session, "--png", png, "--json", out)
    assert done.code == 0
    assert "touches" in done.out
    assert "95 % radius" in done.out
    assert png.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    result = json.loads(out.read_text())
    assert [row["target"] for row in result["targets"]] == [f"P{k}" for k in range(1, 7)]
    for row in result["targets"]:
        assert sum(row[link] for link in result["links"]) == pytest.approx(1)
        assert 0.1 < row["u95_mm"] < 1
    assert result["assumed"]["quantum_mm"] == 0.01


def test_one_target_and_a_requested_orientation(vgrd, session) -> None:
    words = ("--target", "P2", "--policy", "requested", "--work-rotvec-deg", 178, 10, -20)
    result = vgrd("budget", session, *words, "--json", "-").result
    assert [row["target"] for row in result["targets"]] == ["P2"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--policy", "folow"), "choose one of"),
        (("--target", "P9"), "P1, P2"),
        (("--policy", "requested"), "base_from_work"),
        (("--png", "/nowhere/budget.png"), "/nowhere/budget.png"),
    ],
)
def test_what_cannot_be_shared_out_is_refused_by_name(vgrd, session, words, told) -> None:
    done = vgrd("budget", session, *words)
    assert done.code != 0
    assert told in done.err.replace("\n", " ")


def test_advice_for_a_folder_obeys_the_limits_given(vgrd, session) -> None:
    words = ("--policy", "follow", "--tilt-deg", 0, "--yaw-deg", 0)
    result = vgrd("advise", session, *words, "--json", "-").result
    assert len(result["predicted_u95_mm"]) == 6
    assert "tilted" not in result["next"]["words"]
    assert result["next"]["u95_after_mm"] < result["next"]["u95_before_mm"]
    assert vgrd("advise", session, "--policy", "folow").code != 0
