"""A calibration that could only refuse is rejected when it is solved, not request by request."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.world.layout import Layout
from fakes.world.world import CellNoise, World
from vgrd.calibration.joint import JointSolution
from vgrd.calibration.joint.camera_corrections import STRETCH_B
from vgrd.calibration.solve import calibrate_system
from vgrd.clock import SystemClock
from vgrd.errors import Contradiction
from vgrd.model import Plan, Policy, Recording
from vgrd.solving import servable
from vgrd.solving import session as solver
from vgrd.solving.servable import unservable
from vgrd.solving.session import solve_session
from vgrd.store.sessions import SampleKind, SessionWriter


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    world = World(Layout(), 5, CellNoise.none())
    facts = facts_of(world, tmp_path_factory.mktemp("facts"))
    return Rehearsal(world, facts).teach(looks=5, spins=4, tilted=0, points=0)


def stored(recording: Recording, state: Path) -> Path:
    with SessionWriter(state, "s", recording.plan, recording.facts, SystemClock()) as writer:
        for kind, values in (
            (SampleKind.LOOK, recording.looks),
            (SampleKind.SPIN, recording.spins),
            (SampleKind.TOUCH, recording.touches),
        ):
            for value in values:
                writer.sample(kind, value)
    return writer.path


def test_plan_special_without_a_pivot_is_rejected_for_a_wrist_that_stays(
    recording: Recording, tmp_path: Path
) -> None:
    special = replace(recording, plan=Plan.SPECIAL, spins=())
    folder = stored(special, tmp_path)
    fixed = solve_session(folder, tmp_path, policy=Policy.FIXED)
    assert fixed["calibration"] is None
    (finding,) = (one for one in fixed["verdict"]["findings"] if one["code"] == "cannot_be_served")
    assert finding["fatal"]
    assert finding["message"].startswith(
        "P1, P2, P3, P4, P5, P6 cannot be served under policy fixed"
    )
    assert "record spins" in finding["message"]
    follow = solve_session(folder, tmp_path, policy=Policy.FOLLOW)
    assert "cannot_be_served" not in str(follow["verdict"])


@pytest.mark.parametrize("plan", [Plan.JOINT, Plan.SPECIAL])
def test_a_whole_session_can_be_served(recording: Recording, plan: Plan) -> None:
    calibration = calibrate_system(replace(recording, plan=plan))
    assert unservable(calibration, Policy.FIXED) == ()
    assert unservable(calibration, Policy.FOLLOW) == ()


def test_a_tag_that_was_found_to_be_wider_than_high_can_be_served(recording: Recording) -> None:
    """What is asked is how tag B would be measured, its stretch included: without it, it contradicts itself."""
    calibration = calibrate_system(replace(recording, plan=Plan.JOINT))
    solution = calibration.solution
    assert isinstance(solution, JointSolution)
    found = replace(solution.refined[STRETCH_B], value=0.6)  # sigmas
    stretched = replace(solution, refined={**solution.refined, STRETCH_B: found})
    assert unservable(replace(calibration, solution=stretched), Policy.FIXED) == ()


def test_a_contradiction_is_a_reason_not_to_serve(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def contradicted(*_: object) -> None:
        raise Contradiction("tag B moved", ["tag B"], 2.0)

    calibration = calibrate_system(replace(recording, plan=Plan.JOINT))
    monkeypatch.setattr(servable, "expected_coordinate", contradicted)
    (told,) = unservable(calibration, Policy.FIXED)
    assert told.fatal
    assert "cannot be served under policy fixed: tag B moved" in told.message


def test_a_fault_of_ours_in_the_solver_is_told_as_one(
    recording: Recording,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def faulty(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(solver, "calibrate_with_fit", faulty)
    monkeypatch.setattr(solver, "die_with", lambda _: None)
    monkeypatch.setattr(solver.logs, "configure", lambda _: None)
    folder = stored(replace(recording, plan=Plan.UNIVERSAL), tmp_path)
    assert solver.main(["solver", str(folder), str(tmp_path), "1.0", "fixed", "inf"]) == 0
    told = capsys.readouterr().out
    assert '"error": "InternalError"' in told
    assert "internal error in solve: ZeroDivisionError: a bug" in told


@pytest.mark.parametrize(
    ("stability", "told"),
    [
        ("0.5,0.5,0.5,0.0005,0.0005,0.0005", "passes for a knock"),
        ("inf,inf,inf,inf,inf,inf", "either"),
    ],
)
def test_the_solver_process_says_what_one_picture_cannot_tell(
    recording: Recording,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    stability: str,
    told: str,
) -> None:
    monkeypatch.setattr(solver, "die_with", lambda _: None)
    monkeypatch.setattr(solver.logs, "configure", lambda _: None)
    folder = stored(replace(recording, plan=Plan.JOINT), tmp_path)
    assert solver.main(["solver", str(folder), str(tmp_path), "5.0", "fixed", stability]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])["result"]
    of_tag_b, of_the_rest = result["blind_spots"]
    assert "along the arc about the axis" in of_tag_b
    assert told in of_the_rest
