"""What a person saw is what is done; what is not so any more is not shown; what the daemon tells is."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from nicegui import ui

from tests.page.tabs.paper_tab import PaperTab
from vgrd.page.parts import moment
from vgrd.page.shown import offer
from vgrd.page.tabs import ResultTab, SessionsTab, TeachTab
from vgrd.page.visitor import Seen

WHERE = {"target": "P1", "position_mm": [1.0, 2.0, 3.0], "rotvec_deg": [0.0] * 3, "u95_mm": 0.2}
TRIALS = {"calibration": "cal-000001", "verdict": "go", "words": "all is well"}
DIFFERENCE = {"calibration": "cal-000002", "with": "cal-000001", "targets": {}}


@contextmanager
def opened(kind: Any) -> Iterator[PaperTab]:
    tab = PaperTab(kind)
    try:
        yield tab
    finally:
        tab.close()


@pytest.fixture
def teach():
    with opened(TeachTab) as tab:
        tab.look()
        yield tab


@pytest.fixture
def result():
    with opened(ResultTab) as tab:
        tab.told["teaching"] = closed(tab.told["teaching"])
        tab.told |= {
            "calibrations": made(2),
            "trials": TRIALS,
            "status": {"targets": ["P1", "P2"]},
        }
        tab.link.answers |= {"ec": WHERE, "difference": DIFFERENCE}
        tab.look()
        yield tab


def closed(teaching: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """No session is open."""
    step = {**teaching["step"], "kind": "done", "target": None}
    return {**teaching, "session": None, "last": "one", "step": step, **changes}


def made(count: int, active: int = 1) -> dict[str, Any]:
    """So many calibrations."""
    rows = [{"id": f"cal-00000{i}", "active": i == active} for i in range(1, count + 1)]
    return {"active": f"cal-00000{active}", "calibrations": rows}


def test_what_is_chosen_stays_chosen_while_it_can_be():
    with opened(SessionsTab) as tab:
        with tab._client:
            chosen = ui.select([])
        offer(chosen, ["b", "a"], "b")
        assert chosen.value == "b"
        offer(chosen, ["c", "b", "a"], "c")  # somebody else made one
        assert chosen.value == "b"
        offer(chosen, ["c", "a"], "c")
        assert chosen.value is None  # not another one, unasked


def test_somebody_elses_solve_changes_no_choice(result):
    assert result.find("calibration").value == "cal-000002"
    result.find("calibration").value = "cal-000001"
    result.told["calibrations"] = made(3)
    result.look()
    assert result.find("calibration").value == "cal-000001"
    with opened(SessionsTab) as sessions:
        sessions.told["calibrations"] = made(2)
        sessions.look()
        sessions.told["calibrations"] = made(3)
        sessions.look()
        assert sessions.find("first").value == "cal-000001"
        assert sessions.find("second").value == "cal-000002"


def test_activate_is_lit_for_the_one_that_the_step_means_alone(result):
    result.told["calibrations"] = made(3)
    candidate = {"id": "cal-000003"}
    result.told["teaching"] = closed(result.told["teaching"], candidate=candidate)
    result.step(kind="activate", words="cal-000003 is accepted: put it in use")
    assert result.is_lit("activate")  # the newest, as nobody chose another one
    assert "cal-000003" in result.find("candidate").text
    result.find("calibration").value = "cal-000002"
    result.look()
    assert not result.is_lit("activate")


SEEN = {"calibration": "cal-000007", "active": "cal-000008", "trial": "cal-000009"}


@pytest.mark.parametrize(
    ("button", "op", "arguments"),
    [
        ("activate", "activate", {"calibration": "cal-000007"}),
        ("rollback", "rollback", {"active": "cal-000008"}),
        ("verify", "verify", {"calibration": "cal-000009", "target": "P7"}),
        ("undo", "undo", {"calibration": "cal-000009", "kind": "verify"}),
    ],
)
def test_a_command_of_results_takes_what_the_browser_showed(result, button, op, arguments):
    result.press(button, **SEEN, **{"trial-target": "P7"})
    ((given, told),) = result.link.given
    assert given == op
    assert {key: value for key, value in told.items() if key not in ("version", "by")} == arguments


def test_what_results_show_is_what_is_in_use(result):
    shown = result.shown()
    assert (shown["active"], shown["trial"]) == ("cal-000001", "cal-000001")
    assert "cal-000001" in result.find("trials").text


@pytest.mark.parametrize(
    ("button", "op", "arguments"),
    [
        ("touch", "touch", {"target": "P7"}),
        ("verify", "verify", {"target": "P7", "session": "two"}),
        ("undo", "undo", {"sample": "9", "session": "two"}),
        ("retag", "retag", {"sample": "9", "target": "P7"}),
    ],
)
def test_a_command_of_teaching_takes_what_the_browser_showed(teach, button, op, arguments):
    teach.press(button, target="P7", sample="9", session="two")
    assert teach.link.given == [(op, {"version": "v1", **arguments})]


def test_solving_takes_the_session_that_was_shown(teach):
    teach.told["teaching"] = closed(teach.told["teaching"])
    teach.look()
    assert (teach.shown()["session"], teach.shown()["taught"]) == ("", "one")
    teach.press("solve", taught="zero")
    assert teach.link.given == [("solve", {"session": "zero"})]


@pytest.mark.parametrize("button", ["verify", "undo"])
def test_where_no_session_was_shown_no_other_is_meant(teach, button):
    teach.press(button, session="")  # the calibration in use has buttons of its own
    assert teach.link.given == []


def test_the_target_follows_the_step_until_a_person_chooses_another(teach):
    target = teach.find("target")
    assert target.value == "P2"
    teach.step(target="P1")
    assert target.value == "P1"
    target.value = "P2"  # a person's
    teach.step(target="P1", words="put the tip on P1, gently")
    teach.step(kind="wait", target=None)
    teach.step(kind="touch", target="P1")
    assert target.value == "P2"
    teach.step(target="P1", version="v2")  # it was touched
    assert target.value == "P1"


def test_undo_takes_the_last_one_where_the_step_names_none(teach):
    teach.press("undo")
    assert teach.link.given == [("undo", {"version": "v1", "session": "one"})]


def test_undo_and_retag_take_the_touch_that_is_to_be_mended(teach):
    assert not teach.find("retag").visible
    teach.step(kind="mend", sample=3, target=None)
    assert teach.is_lit("undo")
    assert teach.find("undo").text == "UNDO 3"
    assert teach.find("retag").visible
    teach.find("target").value = "P1"
    teach.press("undo")
    teach.press("retag")
    assert teach.link.given == [
        ("undo", {"version": "v1", "session": "one", "sample": "3"}),
        ("retag", {"version": "v1", "sample": "3", "target": "P1"}),
    ]
    teach.step(kind="touch", sample=None, target="P2")
    assert teach.find("undo").text == "UNDO"
    assert not teach.find("retag").visible


def test_point_is_there_where_the_plan_wants_a_touch_beside_the_object(teach):
    assert not teach.find("point").visible
    teach.step(kind="point", target="beside")
    assert teach.is_lit("point")
    teach.press("point")
    assert teach.link.given == [("point", {"version": "v1", "name": "beside"})]
    teach.step(kind="touch", target="P2")
    assert not teach.find("point").visible


def test_what_has_no_target_is_given_none(teach):
    samples = [{**teach.told["teaching"]["samples"][0], "kind": "spin", "target": None}]
    teach.told["teaching"] = {**teach.told["teaching"], "samples": samples}
    teach.step(kind="mend", sample=3, target=None)
    assert not teach.find("retag").visible


def test_a_step_that_names_no_sample_makes_nothing_of_undo(teach):
    teach.step(kind="mend", sample=None, target=None)
    assert not teach.is_lit("undo")
    assert not teach.find("undo").enabled
    assert teach.find("unnamed").visible
    teach.press("undo")  # a press that was on its way
    assert [told.get("sample") for _, told in teach.link.given] == [""]  # refused by the daemon
    teach.step(kind="touch", target="P2")
    assert teach.find("undo").enabled
    assert not teach.find("unnamed").visible


def test_why_not_all_is_recorded_is_told_once(teach):
    disk = {"free_gb": 12.34, "sessions_gb": 1.0, "quota_gb": 20.0, "trouble": ""}
    teach.told["status"] = {"disk": disk}
    teach.look()
    assert "12.3 GB free" in teach.find("disk").text
    assert "refused" not in teach.find("disk").classes
    teach.told["status"] = {"disk": {**disk, "free_gb": None, "sessions_gb": None}}
    teach.look()  # the cell has just begun, and has not looked yet
    assert teach.find("disk").text == ""
    why = "0.1 GB are free"
    warning = f"poses and pictures are not recorded, samples are: {why}"
    teach.told["status"] = {"disk": {**disk, "trouble": why}}
    teach.look()
    assert teach.find("disk").text == why
    teach.told["teaching"] = {**teach.told["teaching"], "warning": warning, "trouble": why}
    teach.look()
    assert teach.find("disk").text == warning
    assert "refused" in teach.find("disk").classes


def test_errors_are_marked_while_they_are_of_other_samples(teach):
    def cells() -> list[str]:
        tables = [one._targets.table for one in (teach.tab,)] + [teach.tab._touches.table]
        rows = [row for table in tables for row in table.rows]
        return [
            row[key] for row in rows for key in ("u95_mm", "off_mm") if row.get(key, "-") != "-"
        ]

    assert not teach.find("old").visible
    assert not any("old" in one for one in cells())
    odd = ["touch 2 is odd"]
    teach.told["teaching"] = {**teach.told["teaching"], "computing": True, "odd": odd}
    teach.look()
    assert teach.find("old").visible
    assert len(cells()) > 1
    assert all("old" in one for one in [*cells(), teach.find("odd").text])


def where(result: PaperTab) -> str:
    """What is shown of it, once it was looked at."""
    result.tab._trials.fade()
    return str(result.find("where-words").text)


def test_where_to_go_says_of_when_its_picture_is(result):
    result.link.answers["ec"] = {**WHERE, "age_s": 3600.0}
    begun = int(time.time())
    result.press("where")
    possible = {moment(at - 3600) for at in range(begun, int(time.time()) + 1)}
    assert any(at in where(result) for at in possible)


def later(result: PaperTab) -> None:
    result.link.clock.sleep(10.1)


def changed(result: PaperTab) -> None:
    result.step(version="v2")


def activated(result: PaperTab) -> None:
    result.told["calibrations"] = made(2, active=2)


def moved(result: PaperTab) -> None:
    result.told["answers"] = {"answers": [answer(position_mm=[1.0, 2.0, 4.0])]}


def hidden(result: PaperTab) -> None:
    result.told["answers"] = {"answers": [answer(position_mm=None)]}


def refused(result: PaperTab) -> None:
    del result.link.answers["ec"]
    result.press("where")


def answer(**changes: Any) -> dict[str, Any]:
    return {
        "unix_s": time.time() + 1,
        "target": "P1",
        "position_mm": WHERE["position_mm"],
        **changes,
    }


@pytest.mark.parametrize("change", [later, changed, activated, moved, hidden, refused])
def test_where_to_go_goes_when_it_may_not_be_so_any_more(result, change):
    result.press("where")
    assert "P1" in where(result)
    change(result)
    assert where(result) == ""


def test_where_to_go_stays_while_robots_are_told_the_same(result):
    result.press("where")
    result.link.clock.sleep(9.0)
    old, other = answer(unix_s=1.0, position_mm=None), answer(target="P2", position_mm=None)
    result.told["answers"] = {"answers": [other, answer(), old]}
    assert "P1" in where(result)


def long_after(result: PaperTab) -> None:
    result.link.clock.sleep(61.0)


@pytest.mark.parametrize("change", [long_after, changed, activated])
def test_a_difference_names_both_and_goes_when_it_may_not_be_so_any_more(result, change):
    result.press("compare")
    result.tab.fade()
    assert result.tab._apart.visible
    words = result.find("between").text
    assert "cal-000002" in words
    assert "cal-000001" in words
    change(result)
    result.tab.fade()
    assert not result.tab._apart.visible


def test_the_calibration_in_use_is_not_verified_while_a_session_is_open(result):
    assert result.find("verify").enabled
    assert not result.find("trials-off").visible
    session = {"name": "two", "plan": "joint", "folder": "/x"}
    result.told["teaching"] = {**result.told["teaching"], "session": session}
    result.look()
    assert not result.find("verify").enabled
    assert not result.find("undo").enabled
    assert result.find("trials-off").visible
    assert "session two is open" in result.find("trials-off").text


@pytest.mark.parametrize("served", [None, "cal-000002"])
def test_verifications_of_what_is_not_in_use_any_more_vouch_for_nothing(result, served):
    result.told["status"] = {**result.told["status"], "calibration": served}
    result.look()
    assert "GO" not in result.find("trials").text
    assert result.shown()["trial"] == ""


@pytest.mark.parametrize("sent", ["", "[]", '["v1", 1]', '["v1", 1, []]', '["v1", 1, 2]', "nan"])
def test_what_cannot_be_read_is_of_no_version(sent):
    seen = Seen.of(sent)
    assert (seen.version, seen.at_s, seen["target"]) == ("unknown", 0.0, "")


def test_what_was_seen_is_read_part_by_part():
    seen = Seen.of('["v1", 1500, {"target": "P2"}]')
    assert (seen.version, seen.at_s, seen["target"], seen["sample"]) == ("v1", 1.5, "P2", "")
