"""What travels beside poses and pixels: health of a process, and commands as JSON lines."""

import json
import math
from dataclasses import asdict, dataclass
from typing import Final, Literal, get_args

from vgrd.errors import ControlError, IpcError

HealthState = Literal["starting", "ok", "unavailable", "refused", "failed"]

HEALTH_KIND: Final = "health"
HEALTH_SLOTS: Final = 4  # only the newest counts; a ring needs two
HEALTH_BYTES: Final = 1024  # twice the longest detail
GATE_RING: Final = "gate.ring"
GATE_KIND: Final = "gate"
GATE_SLOTS: Final = 4  # as of health: only the newest counts
GATE_BYTES: Final = 16384  # chosen: the longest details of some twenty processes
MAX_LINE_BYTES: Final = 1 << 20  # chosen: what a client may make the daemon keep

_DETAIL_BYTES = 512  # chosen: a message with its remedy fits


@dataclass(frozen=True, slots=True)
class Health:
    """What a process says about itself; `progress` counts loops of real work, not of a timer."""

    process: str
    state: HealthState
    progress: int
    detail: str = ""
    pid: int = 0

    def pack(self) -> bytes:
        """JSON for a health ring; a long `detail` is cut to fit the slot."""
        fields = asdict(self) | {"detail": _cut(self.detail)}
        return json.dumps(fields, ensure_ascii=False, separators=(",", ":")).encode()

    @classmethod
    def unpack(cls, payload: bytes) -> "Health":
        """Inverse of `pack`. Raises IpcError when it is not a health message."""
        try:
            health = cls(**json.loads(payload))
        except (ValueError, TypeError) as error:
            raise IpcError(f"not a health message: {error}") from error
        if health.state not in get_args(HealthState) or not isinstance(health.progress, int):
            raise IpcError(f"not a health message: {health}")
        return health


def _cut(text: str) -> str:
    """`text` shortened until its JSON fits; control characters would grow sixfold."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return plain.encode()[:_DETAIL_BYTES].decode(errors="ignore")


@dataclass(frozen=True, slots=True)
class ProcessReport:
    """One row of the gate's process table.

    state: running | waiting (for the next start) | stopped (for good, see exit_code). exit_code:
    of the last end, minus the signal's number when a signal ended it, None before the first.
    """

    name: str
    kind: str
    pid: int
    state: Literal["running", "waiting", "stopped"]
    starts: int
    hangs: int
    exit_code: int | None
    health: HealthState
    detail: str


@dataclass(frozen=True, slots=True)
class GateReport:
    """What the gate publishes for `vgrd status`: processes, and counters of its servers.

    counters: those of the line server begin with `line_`. line_port: None where there is none.
    asked_unix_s: names the last table that was to be taken over. refused: why it was not, else "".
    registers: what a robot read at that moment, the response block in hexadecimal digits. request_s, read_s:
    when a robot asked and read last (monotonic), None where it has not.
    """

    pid: int
    host: str
    port: int
    counters: dict[str, int]
    processes: tuple[ProcessReport, ...]
    asked_unix_s: float = 0.0
    refused: str = ""
    line_port: int | None = None
    registers: str = ""
    request_s: float | None = None
    read_s: float | None = None

    def pack(self) -> bytes:
        """JSON for the gate's ring."""
        fields = asdict(self)
        for process in fields["processes"]:
            process["detail"] = _cut(process["detail"])
        fields["refused"] = _cut(self.refused)
        return json.dumps(fields, ensure_ascii=False, separators=(",", ":")).encode()

    @classmethod
    def unpack(cls, payload: bytes) -> "GateReport":
        """Inverse of `pack`. Raises IpcError when it is no report."""
        try:
            fields = json.loads(payload)
            rows = tuple(ProcessReport(**row) for row in fields.pop("processes"))
            return cls(processes=rows, **fields)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise IpcError(f"not a report of the gate: {error}") from error


def encode_line(message: dict[str, object]) -> bytes:
    """One JSON line. Raises ControlError for what JSON cannot hold (NaN among it)."""
    try:
        return json.dumps(message, allow_nan=False, separators=(",", ":")).encode() + b"\n"
    except (ValueError, TypeError) as error:
        raise ControlError(f"message cannot be sent: {error}") from error


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no JSON number")
    return value


def decode_line(line: bytes) -> dict[str, object]:
    """Inverse of `encode_line`. Raises ControlError naming the fault."""
    if len(line) > MAX_LINE_BYTES:
        raise ControlError(f"message of {len(line)} bytes, at most {MAX_LINE_BYTES} are taken")
    try:
        message = json.loads(line, parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise ControlError(f"message is not JSON: {error}") from error
    if not isinstance(message, dict):
        raise ControlError(f"message is a JSON {type(message).__name__}, not an object")
    return message
