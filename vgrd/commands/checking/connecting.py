"""What `vgrd check --connect` shows: every device asked once, by the daemon where one runs."""

from pathlib import Path
from typing import TYPE_CHECKING

from vgrd.commands.asking import gate_report
from vgrd.commands.checking.snapshot import show_sight
from vgrd.commands.printing import Result, console, show_fields, waiting
from vgrd.errors import VgrdError

if TYPE_CHECKING:
    from vgrd.config.cell_file import CellConfig

_OF_ROBOT = ("flange", "tcp", "robot_at_rest")  # of the daemon's status


def ask_devices(config: "CellConfig") -> tuple[Result, VgrdError | None]:
    """What the devices say, and the first trouble with one."""
    runtime = Path(config.cell.runtime_dir)
    report = gate_report(runtime)
    if report is not None:
        return {"asked": f"the daemon, process {report.pid}", **_of_daemon(runtime, config)}, None
    from vgrd.checking.connecting import connect
    from vgrd.checking.sight import look_at

    with waiting("opening the devices"):
        connected = connect(config)
    result: dict[str, object] = {"asked": "the devices themselves", **connected.told}
    result |= {name: {"trouble": str(err)} for name, err in connected.troubles.items()}
    if connected.picture is not None:
        result["sight"] = look_at(connected.picture, config).to_json()
    return result, next(iter(connected.troubles.values()), None)


def _of_daemon(runtime: Path, config: "CellConfig") -> Result:
    from vgrd.checking.daemon_picture import newest_picture
    from vgrd.checking.sight import look_at
    from vgrd.clock import SystemClock
    from vgrd.config.setup import CONTROL_SOCKET
    from vgrd.ipc.control import ControlClient

    status = ControlClient(runtime / CONTROL_SOCKET).call("status")
    robot = {"state": status["robot"], **{key: status[key] for key in _OF_ROBOT}}
    image = newest_picture(runtime, SystemClock())
    return {
        "robot": robot,
        "camera": {"state": status["camera"]},
        "sight": look_at(image.pixels, config).to_json(),
    }


def show_devices(told: Result) -> None:
    """Tables of what the devices said."""
    sight = told.get("sight")
    show_fields("devices")({key: value for key, value in told.items() if key != "sight"})
    if sight is None:
        console.print("no picture came", highlight=False, markup=False)
    else:
        show_sight(sight, "picture")
