"""The command that tells which link of the chain the error comes from."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import InputError

if TYPE_CHECKING:
    from vgrd.calibration.planning import Budget

# Steps of a robot that told none while teaching, guesses: two and three decimals; some robots tell one
# (docs/decisions/0013).
_STEP_MM, _STEP_DEG = 0.01, 0.001


def register(app: typer.Typer) -> None:
    """Add budget."""
    app.command()(budget)


def budget(
    session: Annotated[Path, typer.Argument(help="A session folder.")],
    target: Annotated[str | None, typer.Option(help="One target; none: all of them.")] = None,
    policy: Annotated[str, typer.Option(help="fixed, follow or requested.")] = "fixed",
    work_rotvec_deg: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Wrist at work, needed for requested; none: as touched."),
    ] = None,
    turn_deg: Annotated[
        float, typer.Option(help="How far the object has turned.")
    ] = 90.0,  # a guess: an error of the centre counts 1.4 times there, 2 at most
    print_percent: Annotated[
        float, typer.Option(min=0, help="Sigma of the tags' size.")
    ] = 0.05,  # as `Systematic.of`
    focal_percent: Annotated[
        float, typer.Option(min=0, help="Sigma of the focal length.")
    ] = 0.03,  # as `Systematic.of`
    center_px: Annotated[
        float, typer.Option(min=0, help="Sigma of cx and cy.")
    ] = 0.5,  # as `Systematic.of`
    drift_mm: Annotated[
        float, typer.Option(min=0, help="Sigma of what moved since.")
    ] = 0.02,  # as `Systematic.of`
    quantum_mm: Annotated[
        float | None,
        typer.Option(min=0, help="Step to which the robot rounds positions; none: as it told."),
    ] = None,
    quantum_deg: Annotated[
        float | None,
        typer.Option(min=0, help="Step to which the robot rounds angles; none: as it told."),
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw it into this file.")] = None,
    json_to: JsonOption = None,
) -> None:
    """Share the error of the expected coordinate out among the links of the chain."""
    from vgrd.calibration.planning import Systematic
    from vgrd.calibration.stated_error import each_target, u95_in_words
    from vgrd.model import Policy
    from vgrd.solving.budget import session_budget
    from vgrd.store.sessions import load_recording

    if policy not in list(Policy):
        raise InputError(f"--policy {policy!r}: choose one of {', '.join(Policy)}")
    recording = load_recording(session)
    facts = recording.facts
    if quantum_mm is None:
        quantum_mm = facts.robot_step_mm or _STEP_MM
    if quantum_deg is None:
        quantum_deg = math.degrees(facts.robot_step_rad) or _STEP_DEG
    systematic = Systematic.of(
        facts,
        print_share=print_percent / 100,
        focal_share=focal_percent / 100,
        center_px=center_px,
        drift_mm=drift_mm,
    )
    shared_out = session_budget(
        recording,
        [target] if target else None,
        Policy(policy),
        work_rotvec_deg,
        turn_deg,
        (quantum_mm, quantum_deg),
        systematic,
    )
    if png is not None:
        draw_shares(shared_out, f"Error budget of {recording.session}, policy {policy}", png)
    assumed = {
        "turn_deg": turn_deg,
        "print_percent": print_percent,
        "focal_percent": focal_percent,
        "center_px": center_px,
        "drift_mm": drift_mm,
        "quantum_mm": quantum_mm,
        "quantum_deg": quantum_deg,
    }
    told = {
        "session": recording.session,
        "policy": policy,
        "u95_includes": u95_in_words(each_target(turn_deg), Policy(policy), holes=0, assumes=True),
    }
    print_result({**told, **shared_out.to_json(), "assumed": assumed}, json_to, _show)


def draw_shares(budget: "Budget", title: str, png: Path) -> None:
    """Draw it into a file; InputError where that cannot be written."""
    from vgrd.solving.budget_chart import draw_budget

    try:
        draw_budget(budget, title).savefig(png)
    except (OSError, ValueError) as err:
        raise InputError(f"--png {png}: cannot be written: {err}") from err


def _show(result: Result) -> None:
    rows = [
        [link, *(f"{100 * target[link]:.1f}" for target in result["targets"])]
        for link in result["links"]
    ]
    rows.append(["95 % radius, mm", *(target["u95_mm"] for target in result["targets"])])
    names = [target["target"] for target in result["targets"]]
    title = f"{result['session']}, {result['policy']}: share in the variance, %"
    console.print(table(title, ("link", *names), rows))
    console.print(f"95 % radius: {result['u95_includes']}", highlight=False)
    for what in result["irrelevant"]:
        console.print(f"{what}: unknown, and irrelevant for this policy", highlight=False)
