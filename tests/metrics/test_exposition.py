"""What is told reads as Prometheus wants it, and as the daemon's status says; what is unknown has no sample."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from vgrd.ipc.messages import GateReport, ProcessReport
from vgrd.metrics.document import document
from vgrd.metrics.exposition import exposition
from vgrd.metrics.facts import Facts
from vgrd.metrics.table import METRICS, Metric
from vgrd.registers import Status

PAGE = Path(__file__).parents[2] / "docs" / "metrics.md"
STATUS = {
    "serving": False,
    "fault": {"status": "CALIBRATION_DRIFT", "reason": "tag B slipped"},
    "calibration": "cal-000002",
    "robot": "ok",
    "camera": "no answer",
    "camera_moved": None,
    "picture_age_s": 0.25,
    "robot_at_rest": True,
    "tag_a_seen": True,
    "tag_b_seen": False,
    "answer": "OK",
    "moved_told_within_s": 0.24,
    "recording": {"session": None, "last": "s1"},
    "cell_file_loaded_unix_s": 1.7e9,
    "disk": {
        "sessions_gb": 1.5,
        "quota_gb": 50.0,
        "free_gb": 9.0,
        "removed": ["f", "g"],
        "removed_total": 7,
        "trouble": "",
    },
}
ROW = ProcessReport("camera", "device", 7, "running", 3, 1, None, "unavailable", "")
REPORT = GateReport(
    1,
    "127.0.0.1",
    502,
    {"requests": 9, "garbage": 2, "starting": 4, "novel": 5, "connections": 1},
    (ROW,),
)
FACTS = Facts(STATUS, REPORT, 11, {"busy": 3})
Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def told(facts: Facts) -> Samples:
    """Samples, as Prometheus' own parser reads them."""
    families = text_string_to_metric_families(exposition(facts).decode())
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in families
        for sample in family.samples
    }


def value(samples: Samples, name: str, **labels: str) -> float:
    return samples[name, frozenset(labels.items())]


@pytest.mark.parametrize(
    ("name", "labels", "expected"),
    [
        ("vgrd_cell_up", {}, 1),
        ("vgrd_serving", {}, 0),
        ("vgrd_fault_code", {}, 503),
        ("vgrd_answer_code", {}, 1),
        ("vgrd_calibration_info", {"calibration": "cal-000002"}, 1),
        ("vgrd_picture_age_seconds", {}, 0.25),
        ("vgrd_device_ok", {"device": "robot"}, 1),
        ("vgrd_device_ok", {"device": "camera"}, 0),
        ("vgrd_tag_seen", {"tag": "a"}, 1),
        ("vgrd_tag_seen", {"tag": "b"}, 0),
        ("vgrd_camera_moved", {}, 0),
        ("vgrd_recording", {}, 0),
        ("vgrd_recording_paused", {}, 0),
        ("vgrd_sessions_bytes", {}, 1.5e9),
        ("vgrd_disk_free_bytes", {}, 9e9),
        ("vgrd_sessions_removed_total", {}, 7),
        ("vgrd_process_up", {"process": "camera"}, 0),
        ("vgrd_process_starts_total", {"process": "camera"}, 3),
        ("vgrd_process_hangs_total", {"process": "camera"}, 1),
        ("vgrd_server_connections", {"server": "modbus"}, 1),
        ("vgrd_server_requests_total", {"server": "modbus"}, 9),
        ("vgrd_server_dropped_total", {"server": "modbus", "reason": "garbage"}, 2),
        ("vgrd_server_dropped_total", {"server": "modbus", "reason": "evicted"}, 0),
        ("vgrd_gate_refusals_total", {"status": str(int(Status.STARTING))}, 4),
        ("vgrd_gate_events_total", {"event": "novel"}, 5),
        ("vgrd_scrapes_total", {}, 11),
        ("vgrd_scrapes_dropped_total", {"reason": "busy"}, 3),
    ],
)
def test_a_metric_tells_what_the_status_says(name, labels, expected) -> None:
    assert value(told(FACTS), name, **labels) == expected


def test_every_metric_has_a_sample_when_all_is_known() -> None:
    names = {name for name, _ in told(FACTS)}
    assert names == {metric.name for metric in METRICS}


def test_nothing_is_told_of_a_cell_that_does_not_answer() -> None:
    samples = told(Facts(None, None))
    assert {name for name, _ in samples} == {
        "vgrd_build_info",
        "vgrd_cell_up",
        "vgrd_scrapes_total",
    }
    assert value(samples, "vgrd_cell_up") == 0


def test_what_the_status_does_not_know_has_no_sample() -> None:
    disk = {**STATUS["disk"], "free_gb": None, "sessions_gb": None}  # type: ignore[dict-item]
    unknown = dict.fromkeys(("robot_at_rest", "tag_a_seen", "tag_b_seen"))
    names = {name for name, _ in told(Facts({**STATUS, **unknown, "disk": disk}))}
    assert not names & {
        "vgrd_tag_seen",
        "vgrd_robot_at_rest",
        "vgrd_disk_free_bytes",
        "vgrd_sessions_bytes",
    }
    assert {"vgrd_sessions_quota_bytes", "vgrd_picture_age_seconds"} <= names


def test_a_cell_without_a_fault_has_code_0() -> None:
    assert value(told(Facts({**STATUS, "fault": None})), "vgrd_fault_code") == 0


@given(
    st.dictionaries(
        st.sampled_from(sorted(STATUS)),
        st.sampled_from((None, True, 7, -0.5, "", "x", {}, [])),
    )
)
def test_a_status_of_another_form_is_told_as_far_as_it_is_known(changes) -> None:
    assert value(told(Facts({**STATUS, **changes})), "vgrd_cell_up") == 1


@given(st.text('ab=,}{"\\\n\té€'))
def test_a_label_may_hold_anything(text: str) -> None:
    metric = Metric("vgrd_x", "gauge", "x", lambda _: [((text,), 1.0)], ("name",))
    lines = exposition(Facts(), [metric]).decode()
    (family,) = text_string_to_metric_families(lines)
    assert [sample.labels["name"] for sample in family.samples] == [text]


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_names_follow_the_convention(metric: Metric) -> None:
    assert metric.name.startswith("vgrd_")
    assert (metric.kind == "counter") == metric.name.endswith("_total")
    assert metric.help.endswith(".")
    assert "\n" not in metric.help
    assert not metric.name.endswith(("_ms", "_s", "_gb"))


def test_names_are_told_once() -> None:
    assert len({metric.name for metric in METRICS}) == len(METRICS)


def test_the_page_is_as_the_table() -> None:
    remedy = "run: python -m vgrd.metrics.document docs/metrics.md"
    assert PAGE.read_text(encoding="utf-8") == document(), remedy


def test_a_server_that_runs_is_told_beside_the_other_and_one_that_does_not_is_not() -> None:
    counters = {"connections": 1, "line_connections": 2, "line_requests": 7, "line_garbage": 3}
    report = GateReport(1, "127.0.0.1", 502, counters, ())
    samples = told(Facts(None, report))
    assert value(samples, "vgrd_server_connections", server="line") == 2
    assert value(samples, "vgrd_server_requests_total", server="line") == 7
    assert value(samples, "vgrd_server_dropped_total", server="line", reason="garbage") == 3
    assert not any(name == "vgrd_gate_events_total" for name, _ in samples)
    assert not any(("server", "line") in labels for _, labels in told(FACTS))
