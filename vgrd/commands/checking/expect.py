"""The command that foresees a cell's error from its file alone."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.budget import draw_shares
from vgrd.commands.printing import JsonOption, Result, console, print_result, table
from vgrd.errors import ConfigError

if TYPE_CHECKING:
    from vgrd.checking.cell_check import CheckedCell
    from vgrd.config.cell_file import CellConfig
    from vgrd.documents.toml_lines import Location

_PARTS = (
    "camera",
    "tags",
    "tool",
    "object",
    "touch",
)  # of the file, which the error depends on
_SMALL_SHARE = 0.01  # of the variance: what counts less is not shown to people


def register(app: typer.Typer) -> None:
    """Add expect."""
    app.command()(expect)


def expect(
    config: Annotated[Path, typer.Argument(help="The cell file.")],
    distance_mm: Annotated[
        float | None, typer.Option(help="Camera to the middle of the object.")
    ] = None,
    tag_tilt_deg: Annotated[
        float | None, typer.Option(help="Between a tag's normal and the line of sight.")
    ] = None,
    tag_b_mm: Annotated[
        float | None,
        typer.Option(help="Tag B to the axis of turning; none: as far as the outermost target."),
    ] = None,
    radius_mm: Annotated[
        float | None, typer.Option(help="Of the circle of targets without point_mm.")
    ] = None,
    tool_mm: Annotated[float | None, typer.Option(help="Flange to tip.")] = None,
    corner_px: Annotated[
        float | None, typer.Option(help="Sigma of a tag's corner in the picture, per axis.")
    ] = None,
    arm_mm: Annotated[
        float | None,
        typer.Option(help="Absolute error of the arm, 1 sigma; none: [robot] sigma_mm."),
    ] = None,
    looks: Annotated[int | None, typer.Option(min=0, help="None: as `vgrd teach` asks.")] = None,
    spins: Annotated[int | None, typer.Option(min=0, help="None: as `vgrd teach` asks.")] = None,
    touches: Annotated[int | None, typer.Option(min=1, help="None: as `vgrd teach` asks.")] = None,
    turned: Annotated[
        int | None, typer.Option(min=0, help="So many of the touches with the object half round.")
    ] = None,
    tilted: Annotated[
        int | None, typer.Option(min=0, help="So many of the touches with the wrist tilted.")
    ] = None,
    four_axes: Annotated[
        bool, typer.Option("--four-axes", help="The wrist turns about the vertical only.")
    ] = False,
    focal_percent: Annotated[
        float | None, typer.Option(min=0, help="Sigma of the focal length.")
    ] = None,
    center_px: Annotated[float | None, typer.Option(min=0, help="Sigma of cx and cy.")] = None,
    drift_mm: Annotated[
        float | None, typer.Option(min=0, help="Sigma of what moves later.")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the shares into this file.")] = None,
    json_to: JsonOption = None,
) -> None:
    """Tell the error that a cell can be expected to have, and what to change first, from its file alone."""
    from vgrd.checking.cell_check import check_cell
    from vgrd.config.setup import camera_stability, cell_facts
    from vgrd.model import Policy
    from vgrd.solving.expectation import Assumptions, Cell, report
    from vgrd.solving.expectation import expect as foresee

    settings = _checked(check_cell(config), config)
    facts = cell_facts(settings)
    given = {
        "distance_mm": distance_mm,
        "tag_tilt_deg": tag_tilt_deg,
        "tag_b_mm": tag_b_mm,
        "radius_mm": radius_mm,
        "tool_mm": tool_mm,
        "corner_px": corner_px,
        "arm_mm": arm_mm,
        "looks": looks,
        "spins": spins,
        "touches": touches,
        "turned": turned,
        "tilted": tilted,
        "four_axes": four_axes,
        "focal_percent": focal_percent,
        "center_px": center_px,
        "drift_mm": drift_mm,
    }
    assumed = Assumptions.of(facts, {k: v for k, v in given.items() if v is not None})
    sigmas_mm = (settings.touch.lateral_sigma_mm, settings.touch.axial_sigma_mm)
    cell = Cell(
        facts, camera_stability(settings), sigmas_mm, Policy(settings.serving.policy), assumed
    )
    limits_mm = (settings.serving.warn_u95_mm, settings.serving.max_u95_mm)
    expectation = foresee(cell)
    if png is not None:
        draw_shares(expectation.budget, f"Expected error of {settings.cell.name}", png)
    told = report(cell, expectation, limits_mm)
    print_result({"cell": settings.cell.name, **told}, json_to, _show)


def _checked(checked: "CheckedCell", path: Path) -> "CellConfig":
    """The cell file without faults in what counts here: drivers and addresses may come later."""
    places, config = checked.places, checked.config
    faults = [
        places.told(remark.where, remark.message)
        for remark in checked.remarks
        if remark.is_fault and (config is None or _counts(remark.where))
    ]
    if faults or config is None:
        raise ConfigError(str(path), faults)
    return config


def _counts(where: "Location") -> bool:
    section, key = [*where, ""][:2]
    return section in _PARTS and key not in ("driver", "settings")


def _show(result: Result) -> None:
    targets = result["targets"]
    rows = [
        [link, *(f"{100 * target[link]:.1f}" for target in targets)]
        for link in result["links"]
        if max(target[link] for target in targets) >= _SMALL_SHARE
    ]
    rows.append(["95 % error, mm", *(target["u95_mm"] for target in targets)])
    title = f"{result['cell']}: share in the variance, %"
    names = [target["target"] for target in targets]
    console.print(table(title, ("link", *names), rows))
    changes = [[change["words"], change["u95_mm"]] for change in result["changes"]]
    title = f"What one change would give, now {result['worst_u95_mm']:.3f} mm"
    console.print(table(title, ("change", "95 % error of the worst target, mm"), changes))
    minutes = ", ".join(f"{kind} {value:.1f}" for kind, value in result["minutes"].items())
    _say(f"operator minutes: {minutes}")
    if result["tag_a_hidden_u95_mm"] is not None:
        hidden_mm = result["tag_a_hidden_u95_mm"]
        _say(f"with tag A hidden in the answers' pictures: {hidden_mm:.2f} mm at the worst target")
    assumed = ", ".join(f"{key} {value:g}" for key, value in result["assumed"].items())
    _say(f"assumed (each is an option): {assumed}")
    _say(f"95 % error: {result['u95_includes']}")
    for remark in result["remarks"]:
        _say(f"warning: {remark}")
    for what in result["not_included"]:
        _say(f"not included: {what}")
    _say(result["in_words"])


def _say(words: str) -> None:
    console.print(words, highlight=False, markup=False)
