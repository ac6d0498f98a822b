"""What is known at one moment: the daemon's status, the gate's report, and the scrapes so far."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from vgrd.clock import Clock
from vgrd.errors import ControlError, IpcError
from vgrd.ipc.control import ControlClient
from vgrd.ipc.messages import GATE_KIND, GATE_RING, GateReport
from vgrd.ipc.ring import RingReader

CONTROL_SOCKET: Final = "control.sock"  # as `vgrd.config.setup`
STATUS_S: Final = 1.0  # chosen: a cell that is busy for longer is told as one that is not up
FRESH_S: Final = 2.0  # the gate reports four times a second


@dataclass(frozen=True, slots=True)
class Facts:
    """status, report: None where nobody tells. scrapes, dropped: connections so far."""

    status: Mapping[str, object] | None = None
    report: GateReport | None = None
    scrapes: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)


def status_of(runtime_dir: Path) -> Mapping[str, object] | None:
    """What `vgrd status` gets, None where the cell does not answer in time."""
    try:
        return ControlClient(runtime_dir / CONTROL_SOCKET).call("status", timeout_s=STATUS_S)
    except ControlError:
        return None


def report_of(runtime_dir: Path, clock: Clock) -> GateReport | None:
    """The gate's last word, None where it is not of now."""
    try:
        with RingReader.open(runtime_dir / GATE_RING, GATE_KIND) as ring:
            message = ring.newest()
        if message is None or clock.monotonic() - message.stamp_s > FRESH_S:
            return None
        return GateReport.unpack(message.payload)
    except IpcError:
        return None
