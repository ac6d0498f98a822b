"""The command that finds what will fail with a cell file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vgrd.commands.checking.connecting import ask_devices, show_devices
from vgrd.commands.printing import JsonOption, Result, console, print_result, show_fields
from vgrd.errors import ConfigError, VgrdError

if TYPE_CHECKING:
    from vgrd.checking.cell_check import CheckedCell
    from vgrd.config.cell_file import CellConfig

_APART = ("warnings", "devices")  # shown below the rest


def register(app: typer.Typer) -> None:
    """Add check."""
    app.command()(check)


def check(
    config: Annotated[Path, typer.Argument(help="The cell file.")],
    connect: Annotated[
        bool,
        typer.Option(
            "--connect",
            help="Open the devices too, and show the flange, the TCP and the tags in a picture; "
            "a daemon that runs is asked instead.",
        ),
    ] = False,
    json_to: JsonOption = None,
) -> None:
    """Check a cell file: every fault is told at once, with its line, and what is only odd as a warning."""
    from vgrd.checking.cell_check import check_cell

    checked = check_cell(config)
    faults = checked.told(faults=True)
    warnings = checked.to_json(faults=False)
    if faults or checked.config is None:
        _refuse(config, checked, faults, json_to)
        return
    result = {"ok": True, **_summary(checked.config), "warnings": warnings}
    trouble: VgrdError | None = None
    if connect:
        result["devices"], trouble = ask_devices(checked.config)
        result["ok"] = trouble is None

    def show(result: Result) -> None:
        told = {key: value for key, value in result.items() if key not in _APART}
        show_fields(f"{config} is good")(told)
        _show_warnings(checked)
        if connect:
            show_devices(result["devices"])

    print_result(result, json_to, show)
    if trouble is not None:
        raise trouble


def _summary(config: "CellConfig") -> Result:
    return {
        "cell": config.cell.name,
        "robot": config.robot.driver,
        "camera": config.camera.driver,
        "targets": [target.name for target in config.object.targets],
        "registers": f"{config.serving.host}:{config.serving.port}",
        "state_dir": config.cell.state_dir,
        "runtime_dir": config.cell.runtime_dir,
    }


def _refuse(config: Path, checked: "CheckedCell", faults: list[str], json_to: str | None) -> None:
    """Raise ConfigError with all faults; the warnings are told first."""
    if json_to is not None:
        result = {
            "ok": False,
            "faults": checked.to_json(faults=True),
            "warnings": checked.to_json(faults=False),
        }
        print_result(result, json_to, lambda _: None)
    for warning in checked.told(faults=False):
        typer.echo(f"warning: {warning}", err=True)
    raise ConfigError(str(config), faults)


def _show_warnings(checked: "CheckedCell") -> None:
    for warning in checked.told(faults=False):
        console.print(f"warning: {warning}", highlight=False, markup=False)
