"""What a robot reads at this moment, in words: from the gate's own report, not from what the cell meant to say."""

import struct
from collections.abc import Mapping
from typing import Final

from vgrd.ipc.messages import GateReport
from vgrd.registers import RESPONSE, State, Status
from vgrd.registers.answer import LARGEST32, UNKNOWN16
from vgrd.registers.remedies import REMEDIES

_AXES: Final = ("X", "Y", "Z")
_MM_PER_UM: Final = 1e-3
_DEG_PER_URAD: Final = 1e-6 * 57.29577951308232  # as `EC32_R*` of a rotation vector has them
Fault = tuple[Status, str]


def robot_view(
    report: GateReport, told_s: float, now_s: float, fault: Fault | None
) -> dict[str, object]:
    """The registers of a report that was written at `told_s`; fault: why nothing can be served, in words."""
    block = bytes.fromhex(report.registers)
    values = RESPONSE.decode(block)
    status, bits = Status(int(values["STATUS"])), State(int(values["STATE"]))
    is_valid = State.VALID in bits
    cause = fault[0] if fault is not None and not is_valid else status
    return {
        "age_s": round(now_s - told_s, 3),
        "state": state_word(status, bits),
        "valid": is_valid,
        "status": int(status),
        "name": status.name,
        "cause": cause.name,
        "words": fault[1] if cause is not status and fault and fault[1] else cause.description,
        "remedy": REMEDIES[cause.name].operator,
        **_coordinate(values, is_valid=is_valid),
        "point": int(values["POINT"]),
        "object": int(values["OBJECT"]),
        "echo": int(values["ECHO"]),
        "seq": int(values["SEQ"]),
        "beat": int(values["HB"]),
        "calid": f"{int(values['CALID']):08x}",
        "registers": list(struct.unpack(f">{len(block) // 2}H", block)),
        "requests": report.counters.get("triggers", 0),
        "asked_s_ago": _since(report.request_s, now_s),
        "read_s_ago": _since(report.read_s, now_s),
        "connections": report.counters.get("connections", 0),
    }


def state_word(status: Status, bits: State) -> str:
    """One word for the whole: STARTING, INVALID, BUSY, DEGRADED or READY."""
    if status is Status.STARTING:
        return "STARTING"
    if State.BUSY in bits:
        return "BUSY"
    if State.ERROR in bits or State.READY not in bits:
        return "INVALID"
    return "DEGRADED" if bits & (State.DEGRADED | State.HELD) else "READY"


def _coordinate(values: Mapping[str, float], *, is_valid: bool) -> dict[str, object]:
    """The int32 block in mm and degrees, None where no coordinate stands there."""
    age_ms, u95_um = int(values["AGE"]), int(values["EC32_U95"])
    return {
        "position_mm": [_MM_PER_UM * values[f"EC32_{axis}"] for axis in _AXES]
        if is_valid
        else None,
        "rotvec_deg": [_DEG_PER_URAD * values[f"EC32_R{axis}"] for axis in _AXES]
        if is_valid and not int(values["FMT"]) & 0xF
        else None,
        "age_ms": age_ms if is_valid and age_ms < UNKNOWN16 else None,
        "u95_mm": _MM_PER_UM * u95_um if is_valid and 0 <= u95_um < LARGEST32 else None,
    }


def _since(then_s: float | None, now_s: float) -> float | None:
    return None if then_s is None else round(now_s - then_s, 2)
