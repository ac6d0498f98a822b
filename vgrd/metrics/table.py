"""Every metric: its name by the convention of Prometheus, what it means, where it comes from.

What is not known has no sample. Nothing is repeated from an earlier scrape.
"""

import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import vgrd
from vgrd.ipc.messages import ProcessReport
from vgrd.metrics.facts import Facts
from vgrd.registers import Status

Sample = tuple[tuple[str, ...], float]  # values of the labels, and the number
Read = Callable[[Facts], Iterable[Sample]]
_BYTES_PER_GB: Final = 1e9  # as `vgrd status` counts

# Counters of the gate that have a metric with a name of their own; the others are events.
_REQUESTS, _EXCEPTIONS, _ACCEPTED, _CONNECTIONS = (
    "requests",
    "exceptions",
    "accepted",
    "connections",
)
_TRIGGERS, _SUPERSEDED = "triggers", "superseded"
_DROPPED: Final = ("refused", "garbage", "timeouts", "evicted")
_SERVERS: Final = (("modbus", ""), ("line", "line_"))  # and what their counters begin with
_OF_SERVERS: Final = (_REQUESTS, _EXCEPTIONS, _ACCEPTED, _CONNECTIONS, *_DROPPED)
_NAMED: Final = {
    *(f"{prefix}{name}" for _, prefix in _SERVERS for name in _OF_SERVERS),
    *(_TRIGGERS, _SUPERSEDED),
}
_CODES: Final = {status.name: int(status) for status in Status}
_STATUS_NAMES: Final = {status.name.lower(): status for status in Status}


@dataclass(frozen=True, slots=True)
class Metric:
    """One family of samples."""

    name: str
    kind: Literal["gauge", "counter"]
    help: str
    read: Read
    labels: tuple[str, ...] = ()


def _build(_: Facts) -> Iterable[Sample]:
    yield (vgrd.__version__, platform.python_version()), 1.0


def _cell_up(facts: Facts) -> Iterable[Sample]:
    yield (), float(facts.status is not None)


def _entry(facts: Facts, *keys: str) -> object:
    """An entry of the status, None where it or what leads to it is not there."""
    found: object = facts.status
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found


def _number(*keys: str, factor: float = 1.0) -> Read:
    """A number or a truth of the status."""

    def read(facts: Facts) -> Iterable[Sample]:
        value = _entry(facts, *keys)
        if isinstance(value, int | float):
            yield (), factor * float(value)

    return read


def _is_told(*keys: str) -> Read:
    """1 where an entry of the status says something, 0 where it is empty."""

    def read(facts: Facts) -> Iterable[Sample]:
        if facts.status is not None:
            yield (), float(bool(_entry(facts, *keys)))

    return read


def _each(label_keys: Mapping[str, str], is_good: Callable[[object], bool]) -> Read:
    """One sample for each key of the status, under its label."""

    def read(facts: Facts) -> Iterable[Sample]:
        for label, key in label_keys.items():
            if (value := _entry(facts, key)) is not None:
                yield (label,), float(is_good(value))

    return read


def _code(*keys: str) -> Read:
    """The number of a status that is told by its name; 0 where none is told."""

    def read(facts: Facts) -> Iterable[Sample]:
        if facts.status is not None:
            name = _entry(facts, *keys)
            yield (), float(_CODES.get(str(name), 0))

    return read


def _calibration(facts: Facts) -> Iterable[Sample]:
    if name := _entry(facts, "calibration"):
        yield (str(name),), 1.0


def _processes(number: Callable[[ProcessReport], float]) -> Read:
    def read(facts: Facts) -> Iterable[Sample]:
        for row in facts.report.processes if facts.report else ():
            yield (row.name,), number(row)

    return read


def _counter(name: str) -> Read:
    def read(facts: Facts) -> Iterable[Sample]:
        if facts.report:
            yield (), float(facts.report.counters.get(name, 0))

    return read


def _servers(counters: Mapping[str, int]) -> Iterable[tuple[str, str]]:
    """Names of the servers that run, and what their counters' names begin with."""
    return [(name, prefix) for name, prefix in _SERVERS if f"{prefix}{_CONNECTIONS}" in counters]


def _by_server(name: str) -> Read:
    def read(facts: Facts) -> Iterable[Sample]:
        counters = facts.report.counters if facts.report else {}
        for server, prefix in _servers(counters):
            yield (server,), float(counters.get(f"{prefix}{name}", 0))

    return read


def _dropped(facts: Facts) -> Iterable[Sample]:
    counters = facts.report.counters if facts.report else {}
    for server, prefix in _servers(counters):
        for reason in _DROPPED:
            yield (server, reason), float(counters.get(f"{prefix}{reason}", 0))


def _refusals(facts: Facts) -> Iterable[Sample]:
    for name, count in facts.report.counters.items() if facts.report else ():
        if name in _STATUS_NAMES:
            yield (str(int(_STATUS_NAMES[name])),), float(count)


def _events(facts: Facts) -> Iterable[Sample]:
    for name, count in facts.report.counters.items() if facts.report else ():
        if name not in _NAMED and name not in _STATUS_NAMES:
            yield (name,), float(count)


def _scrapes_dropped(facts: Facts) -> Iterable[Sample]:
    for reason, count in facts.dropped.items():
        yield (reason,), float(count)


METRICS: Final = (
    Metric(
        "vgrd_build_info",
        "gauge",
        "Version of vgrd and of Python; always 1.",
        _build,
        ("version", "python"),
    ),
    Metric("vgrd_cell_up", "gauge", "1 while the cell process answers.", _cell_up),
    Metric(
        "vgrd_serving",
        "gauge",
        "1 while nothing stops coordinates from being served.",
        _number("serving"),
    ),
    Metric(
        "vgrd_fault_code",
        "gauge",
        "STATUS of what stops them, 0 without; docs/status-codes.md.",
        _code("fault", "status"),
    ),
    Metric(
        "vgrd_answer_code", "gauge", "STATUS of the last answer to the robot.", _code("answer")
    ),
    Metric(
        "vgrd_calibration_info",
        "gauge",
        "The calibration in use; always 1.",
        _calibration,
        ("calibration",),
    ),
    Metric(
        "vgrd_picture_age_seconds",
        "gauge",
        "Since the exposure of the newest picture that was evaluated.",
        _number("picture_age_s"),
    ),
    Metric(
        "vgrd_moved_told_seconds",
        "gauge",
        "Within this an object that moves ends an answer.",
        _number("moved_told_within_s"),
    ),
    Metric(
        "vgrd_device_ok",
        "gauge",
        "1 while the device works.",
        _each({"robot": "robot", "camera": "camera"}, lambda v: v == "ok"),
        ("device",),
    ),
    Metric(
        "vgrd_tag_seen",
        "gauge",
        "1 while the tag is in the newest picture.",
        _each({"a": "tag_a_seen", "b": "tag_b_seen"}, bool),
        ("tag",),
    ),
    Metric(
        "vgrd_robot_at_rest",
        "gauge",
        "1 where the arm stood while the newest picture was taken.",
        _number("robot_at_rest"),
    ),
    Metric(
        "vgrd_camera_moved",
        "gauge",
        "1 while the camera is found elsewhere than it was taught.",
        _is_told("camera_moved"),
    ),
    Metric(
        "vgrd_recording",
        "gauge",
        "1 while a session is recorded.",
        _is_told("recording", "session"),
    ),
    Metric(
        "vgrd_recording_paused",
        "gauge",
        "1 while the disk has no room for recordings.",
        _is_told("disk", "trouble"),
    ),
    Metric(
        "vgrd_sessions_bytes",
        "gauge",
        "What the recorded sessions take.",
        _number("disk", "sessions_gb", factor=_BYTES_PER_GB),
    ),
    Metric(
        "vgrd_sessions_quota_bytes",
        "gauge",
        "What they may take.",
        _number("disk", "quota_gb", factor=_BYTES_PER_GB),
    ),
    Metric(
        "vgrd_disk_free_bytes",
        "gauge",
        "Free on the disk of the state folder.",
        _number("disk", "free_gb", factor=_BYTES_PER_GB),
    ),
    Metric(
        "vgrd_sessions_removed_total",
        "counter",
        "Sessions that gave way since the cell process started.",
        _number("disk", "removed_total"),
    ),
    Metric(
        "vgrd_cell_file_loaded_timestamp_seconds",
        "gauge",
        "When the cell file in force was read, Unix time.",
        _number("cell_file_loaded_unix_s"),
    ),
    Metric(
        "vgrd_process_up",
        "gauge",
        "1 while the process of the daemon runs and is well.",
        _processes(lambda row: float(row.state == "running" and row.health == "ok")),
        ("process",),
    ),
    Metric(
        "vgrd_process_starts_total",
        "counter",
        "How often it was started.",
        _processes(lambda row: row.starts),
        ("process",),
    ),
    Metric(
        "vgrd_process_hangs_total",
        "counter",
        "How often it was killed since it made no progress.",
        _processes(lambda row: row.hangs),
        ("process",),
    ),
    Metric(
        "vgrd_server_connections",
        "gauge",
        "Clients that are connected, by server: modbus or line.",
        _by_server(_CONNECTIONS),
        ("server",),
    ),
    Metric(
        "vgrd_server_accepted_total",
        "counter",
        "Connections that were accepted.",
        _by_server(_ACCEPTED),
        ("server",),
    ),
    Metric(
        "vgrd_server_dropped_total",
        "counter",
        "Connections that were refused or ended, by reason.",
        _dropped,
        ("server", "reason"),
    ),
    Metric(
        "vgrd_server_requests_total",
        "counter",
        "Requests that were answered.",
        _by_server(_REQUESTS),
        ("server",),
    ),
    Metric(
        "vgrd_server_exceptions_total",
        "counter",
        "Of these, with an exception.",
        _by_server(_EXCEPTIONS),
        ("server",),
    ),
    Metric(
        "vgrd_triggers_total", "counter", "Coordinates that robots asked for.", _counter(_TRIGGERS)
    ),
    Metric(
        "vgrd_triggers_superseded_total",
        "counter",
        "Of these, replaced by a newer one before an answer.",
        _counter(_SUPERSEDED),
    ),
    Metric(
        "vgrd_gate_refusals_total",
        "counter",
        "Requests that were refused without the cell process, by STATUS.",
        _refusals,
        ("status",),
    ),
    Metric("vgrd_gate_events_total", "counter", "What else the gate counts.", _events, ("event",)),
    Metric(
        "vgrd_scrapes_total",
        "counter",
        "Answers to Prometheus.",
        lambda facts: [((), float(facts.scrapes))],
    ),
    Metric(
        "vgrd_scrapes_dropped_total",
        "counter",
        "Connections to this port that were dropped, by reason.",
        _scrapes_dropped,
        ("reason",),
    ),
)
