"""A missed figure of time is blamed on the machine only with evidence."""

import ctypes
import time

from fakes.cell.load import BUSY_LATE_S, BUSY_SHARE, Load, Moment


def evidence(monkeypatch, late_s: float, share: float, missing_s: float = 0.0) -> str:
    monkeypatch.setattr("fakes.cell.load._waited_s", lambda: 10.0 * share)
    load = Load()
    load._late.append((time.monotonic(), late_s))
    return load.evidence(Moment(time.monotonic() - 10.0, 0.0), missing_s)


def test_a_machine_with_time_to_spare_excuses_nothing(monkeypatch) -> None:
    assert evidence(monkeypatch, BUSY_LATE_S / 2, BUSY_SHARE / 2) == ""


def test_a_late_process_or_waiting_tasks_are_evidence_in_words(monkeypatch) -> None:
    assert "200 ms late" in evidence(monkeypatch, 0.2, 0.0)
    assert "95 % of the time" in evidence(monkeypatch, 0.0, 0.95)


def test_a_short_delay_excuses_no_long_one(monkeypatch) -> None:
    assert evidence(monkeypatch, 0.2, 0.0, missing_s=0.8)
    assert evidence(monkeypatch, 0.2, 0.0, missing_s=5.0) == ""


def test_what_was_before_the_span_is_no_evidence(monkeypatch) -> None:
    monkeypatch.setattr("fakes.cell.load._waited_s", lambda: 7.0)
    load = Load()
    load._late.append((time.monotonic() - 1.0, 3.0))
    assert load.evidence(Moment(time.monotonic(), 7.0)) == ""


def test_a_process_that_is_kept_from_running_is_seen_to_be_late() -> None:
    hold_the_interpreter = ctypes.PyDLL(
        None
    ).usleep  # PyDLL: no other thread of ours runs meanwhile
    with Load() as load:
        time.sleep(0.05)
        since = load.now()
        hold_the_interpreter(400_000)
        end_s = time.monotonic() + 60.0
        while not load.evidence(since, missing_s=1.0) and time.monotonic() < end_s:
            time.sleep(0.01)
        assert "late" in load.evidence(since, missing_s=1.0)


def test_a_figure_below_its_limit_is_good_whatever_the_machine_does(stopwatch) -> None:
    stopwatch.judge("nothing", 0.5, 1.0)
