"""The page in a real browser: what it shows, and that it never shows what is not so any more."""

import re
from typing import Any

import pytest

from tests.page.browser import (
    PageProcess,
    browser,
    is_grey,
    need_browser,
    open_page,
    press,
    tab,
    until,
)
from tests.page.daemon import PaperDaemon, full
from vgrd.page import texts
from vgrd.page.link import STALE_S

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

GRAVE = ("serious", "critical")
LEAST_PX = (
    64  # of what is pressed; 12 mm on 1280 px of 10 inches are 71, a tab has its line below it
)
HEIGHTS = """[...document.querySelectorAll('button, [role=tab], a.press, .q-field__control')]
    .filter(one => one.offsetParent)
    .map(one => one.getBoundingClientRect().height)"""


@pytest.fixture(scope="module", autouse=True)
def _able() -> None:
    need_browser()


@pytest.fixture
def daemon(tmp_path):
    with PaperDaemon(tmp_path) as daemon:
        daemon.films = True
        yield daemon


@pytest.fixture
def server(daemon, tmp_path):
    with PageProcess(tmp_path) as server:
        yield server


@pytest.fixture
def page(server):
    with browser() as opened:
        yield open_page(opened, server.url)


def test_it_shows_the_state_and_asks_no_host_but_its_own(page, server, daemon):
    assert page.locator(".state .word").inner_text() == "● READY"
    for name in ("Teach", "Result", "Runtime", "Sessions", "Cell"):
        tab(page, name)
    until(lambda: "tag A (36h11 id 0) seen" in page.locator(".picture-words").first.inner_text())
    until(lambda: page.evaluate("document.querySelector('.live').naturalWidth") == 40)
    assert page.locator(".marks polygon").first.get_attribute("points") == "1,1 9,1 9,9 1,9"
    daemon.replies["registers"] |= {
        "state": "INVALID",
        "name": "CAMERA_OFFLINE",
        "words": "the camera does not answer",
        "remedy": "Look at the cable",
    }
    until(lambda: page.locator(".state.INVALID").count() == 1)
    assert "Look at the cable" in page.locator(".state").inner_text()
    assert page.hosts == {f"127.0.0.1:{server.port}"}
    assert page.faults == []
    assert "Traceback" not in server.log


def grave_faults(page) -> list[tuple[str, str]]:
    """What axe-core finds, once the tab that was pressed has its colours again."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in GRAVE]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_nothing_is_cut_small_or_unreadable(server, daemon, tmp_path, theme):
    """By axe-core; by the width of the screen; by the height that a gloved finger on a tablet needs."""
    daemon.replies |= full(tmp_path)
    with browser() as opened:
        page = open_page(opened, server.url, color_scheme=theme)
        for width, height in ((1280, 800), (800, 1280), (390, 844)):
            page.set_viewport_size({"width": width, "height": height})
            for name in ("Cell", "Teach", "Result", "Runtime", "Sessions"):
                tab(page, name)
                if width != 800:  # between the others; axe takes a second
                    until(lambda: grave_faults(page) == [], name)
                assert page.evaluate("document.documentElement.scrollWidth") <= width, name
                assert min(page.evaluate(HEIGHTS)) >= LEAST_PX, name


def test_a_result_is_told_in_words_first_and_its_report_opens(page, daemon, tmp_path):
    daemon.replies |= full(tmp_path)
    result = daemon.replies["result"]["result"]
    tab(page, "Result")
    until(lambda: page.get_by_text("✔ ACCEPTED: one, cal-000001").is_visible())
    assert page.get_by_text("✔ GO", exact=True).is_visible()
    assert page.get_by_text(result["verification"]["words"], exact=True).is_visible()
    until(lambda: page.get_by_text("touches across the tool").is_visible())
    with page.expect_popup() as opening:
        page.get_by_role("link", name=texts.REPORT).first.click()
    opening.value.get_by_role("heading", name="Calibration report").wait_for()
    daemon.replies["result"] = {
        "session": "two",
        "result": {
            **result,
            "calibration": None,
            "verdict": {"ok": False, "findings": []},
            "verification": {**result["verification"], "verdict": "no go", "words": "off by 8 mm"},
        },
    }
    until(lambda: page.get_by_text("✖ REJECTED: two").is_visible())
    assert page.get_by_text("✖ NO GO", exact=True).is_visible()
    assert page.faults == []


def test_the_cell_is_drawn_and_turned(page, daemon, tmp_path):
    daemon.replies |= full(tmp_path)
    tab(page, "Teach")
    until(lambda: page.locator("svg.scene text.goal").count() == 1)
    before = page.locator("svg.scene polygon.flange").get_attribute("points")
    press(page, texts.VIEWS["right"])
    until(lambda: page.locator("svg.scene polygon.flange").get_attribute("points") != before)
    assert page.get_by_text("Move the flange by").is_visible()


def test_two_calibrations_are_compared_and_sessions_listed(page, daemon, tmp_path):
    daemon.replies |= full(tmp_path)
    tab(page, "Sessions")
    press(page, "LIST")
    until(lambda: page.get_by_text("touch 6").count() == 1)
    assert (
        page.get_by_role("link", name=texts.REPORT).last.get_attribute("href")
        == "/report?session=one"
    )


REACHED = """() => { const one = document.activeElement; return one === document.body ? "" :
    one.tagName + (one.textContent || one.getAttribute("aria-label") || "").trim(); }"""
TO_REACH = """[...document.querySelectorAll('button, a[href], input')]
    .filter(one => one.offsetParent && !one.disabled && one.closest(".q-table__bottom") === null)
    .map(one => one.tagName + (one.textContent || one.getAttribute("aria-label") || "").trim())"""


def test_everything_can_be_reached_by_keyboard(page, daemon, tmp_path):
    daemon.replies |= full(tmp_path)
    for name in ("Cell", "Teach", "Result", "Runtime", "Sessions"):
        tab(page, name)
        wanted = set(page.evaluate(TO_REACH))
        reached = set()
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.add(page.evaluate(REACHED))
        assert wanted <= reached, name


def test_a_choice_opens_wide_enough_for_a_glove(page, daemon):
    tab(page, "Teach")
    page.get_by_role("combobox", name=texts.TARGET).click()
    choice = page.get_by_role("option").first
    choice.wait_for()
    assert choice.bounding_box()["height"] >= LEAST_PX


def stays_grey(page) -> bool:
    """A busy machine turns it grey for a moment before the freeze is known."""
    return bool(page.evaluate(GREY_FOR_A_SECOND))


PULSE_AGE_MS = "fetch('pulse').then(reply => reply.json()).then(pulse => pulse.age_ms)"
GREY_FOR_A_SECOND = """async () => { for (let i = 0; i < 10; i++) {
    if (!document.body.classList.contains("stale")) return false;
    await new Promise(done => setTimeout(done, 100)); }
    return true; }"""


@pytest.mark.parametrize("what", ["cell", "gate", "page", "network"])
def test_whatever_freezes_it_turns_grey_and_its_buttons_are_dead(page, server, daemon, what):
    tab(page, "Teach")
    button = page.get_by_role("button", name="TOUCH", include_hidden=True)
    button.wait_for()
    freeze, thaw = {
        "cell": (daemon.freeze, daemon.thaw),
        "page": (server.freeze, server.thaw),
        "network": (
            lambda: page.context.set_offline(True),
            lambda: page.context.set_offline(False),
        ),
        "gate": (
            lambda: daemon.replies["registers"].update(age_s=9.0),
            lambda: daemon.replies["registers"].update(age_s=0.01),
        ),
    }[what]
    freeze()
    until(lambda: stays_grey(page))
    assert page.locator("#no-link").is_visible()
    assert page.locator("#no-link").inner_text() == texts.NO_LINK
    button.evaluate("one => one.focus()")
    assert (
        page.evaluate("document.activeElement.tagName") == "BODY"
    )  # the keyboard does not reach it
    box = button.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.keyboard.press("Enter")
    thaw()
    until(lambda: not is_grey(page))
    assert daemon.given == []


def test_a_silent_websocket_turns_it_grey_though_the_pulse_goes_on(page, daemon):
    """All that is shown comes by the websocket, the pulse by requests."""
    lost: list[bool] = []

    def pass_on(browser_end: Any) -> None:
        server_end = browser_end.connect_to_server()
        browser_end.on_message(lambda message: lost or server_end.send(message))
        server_end.on_message(lambda message: lost or browser_end.send(message))

    page.route_web_socket(re.compile("socket.io"), pass_on)
    page.reload()
    until(lambda: page.locator(".state .word").inner_text() == "● READY" and not is_grey(page))
    lost.append(True)
    daemon.replies["registers"] |= {"state": "INVALID", "name": "CAMERA_OFFLINE"}
    until(lambda: stays_grey(page))
    until(lambda: page.evaluate(PULSE_AGE_MS) < 1e3 * STALE_S)
    assert is_grey(page)
    assert page.locator(".state .word").inner_text() == "● READY"  # as it was
    lost.clear()
    page.reload()
    until(lambda: page.locator(".state .word").inner_text() == "■ INVALID" and not is_grey(page))


def test_what_cannot_be_shown_turns_it_grey(page, daemon):
    """As if a fault of ours were in one tab: what that tab shows is of before."""
    good, bad = daemon.replies["answers"], {"answers": [{"fault": "of ours"}], "counts": {}}
    daemon.replies["answers"] = bad
    until(lambda: stays_grey(page))
    daemon.replies["answers"] = good
    until(lambda: not is_grey(page))


def test_a_picture_that_no_other_follows_tells_its_age_and_is_grey(page, daemon):
    words = page.locator(".picture-words").first
    until(lambda: "arm at rest" in words.inner_text())
    assert page.locator(".view.old").count() == 0
    daemon.films = False
    until(lambda: page.locator("[data-tab=cell] .view.old").count() == 1)
    until(lambda: "no other picture for 3 s" in words.inner_text())
    assert "at rest" not in words.inner_text()
    assert not is_grey(page)  # the cell lives
    daemon.films = True
    until(lambda: "arm at rest" in words.inner_text())
    assert page.locator("[data-tab=cell] .view.old").count() == 0


def test_what_the_daemon_refuses_is_gone_from_the_page_and_its_words_are_there(
    page, daemon, tmp_path
):
    daemon.replies |= full(tmp_path)
    tab(page, "Result")
    go = page.get_by_text(f"{texts.GOES['go']}: ")
    until(lambda: go.is_visible() and page.get_by_text("✔ ACCEPTED").is_visible())
    daemon.refused["trials"] = "nothing to verify"
    daemon.refused["result"] = "the result cannot be read"
    until(lambda: page.get_by_text("nothing to verify").is_visible())
    until(lambda: page.get_by_text("the result cannot be read").is_visible())
    assert not go.is_visible()
    assert not page.get_by_text("✔ ACCEPTED").is_visible()
    tab(page, "Teach")
    daemon.refused["teaching"] = "the wizard is lost"
    until(lambda: page.get_by_text("teaching: the wizard is lost").is_visible())
    until(lambda: not page.get_by_role("button", name="TOUCH").is_visible())
    tab(page, "Cell")
    daemon.refused["calibrations"] = "the shelf is lost"
    until(lambda: page.get_by_text("the shelf is lost", exact=True).is_visible())
    daemon.refused.clear()
    tab(page, "Teach")
    until(lambda: page.get_by_role("button", name="TOUCH").is_visible())


def test_a_command_says_which_version_was_shown(page, daemon):
    tab(page, "Teach")
    press(page, "TOUCH")
    until(lambda: daemon.given)
    assert daemon.given == [("touch", {"target": "P2", "version": "v1"})]
    until(lambda: page.get_by_text("touch: recorded as sample 7").count())


def test_a_press_takes_what_the_browser_showed(page, daemon):
    """What the server has drawn since may not have come yet: then the browser shows what it showed."""
    tab(page, "Teach")
    until(lambda: page.locator("[data-fact=target] input").input_value() == "P2")
    page.evaluate("document.querySelector('[data-fact=sample]').textContent = '9'")
    for button in ("TOUCH", "VERIFY", "UNDO"):
        press(page, button)
        until(lambda button=button: daemon.given[-1:] and daemon.given[-1][0] == button.lower())
    assert daemon.given == [
        ("touch", {"target": "P2", "version": "v1"}),
        ("verify", {"target": "P2", "version": "v1", "session": "one"}),
        ("undo", {"version": "v1", "session": "one", "sample": "9"}),
    ]


def test_a_choice_of_a_person_stays_and_is_what_is_activated(page, daemon, tmp_path):
    daemon.replies |= full(tmp_path)
    tab(page, "Result")
    shown = page.locator("[data-fact=calibration]")
    until(lambda: shown.locator("input").input_value() == "cal-000002")
    shown.click()
    page.get_by_role("option", name="cal-000001").click()
    rows = daemon.replies["calibrations"]["calibrations"]
    more = [*rows, {**rows[0], "id": "cal-000003"}]
    daemon.replies["calibrations"] = {**daemon.replies["calibrations"], "calibrations": more}
    until(lambda: page.locator("[data-tab=result]").get_by_text("cal-000003").count())
    press(page, "ACTIVATE")
    press(page, "ROLL BACK")
    until(lambda: len(daemon.given) == 2)
    (_, activated), (_, left) = daemon.given
    assert (activated["calibration"], left["active"]) == ("cal-000001", "cal-000002")
    assert page.locator("[data-tab=result]").get_by_role("button", name="VERIFY").is_disabled()


def test_many_presses_are_one_command(page, daemon):
    tab(page, "Teach")
    daemon.held.add("spin")
    for _ in range(7):
        press(page, "SPIN")
    until(lambda: page.get_by_text("still busy with spin").count())
    daemon.held.clear()
    until(lambda: page.get_by_text("spin: recorded as sample 7").count())
    assert daemon.given == [("spin", {"version": "v1"})]


def test_a_command_from_a_page_that_is_behind_is_refused_in_words(page, daemon):
    tab(page, "Teach")
    page.evaluate("document.getElementById('version').textContent = 'v0'")  # as if it came late
    press(page, "SPIN")
    until(lambda: page.get_by_text("somebody did something else").count())
    assert daemon.given == []


def test_a_second_browser_follows_along(page, server, daemon):
    other = open_page(page.context.browser, server.url)
    for one in (page, other):
        tab(one, "Teach")
        until(lambda one=one: "P2" in one.locator(".step").inner_text())
    step = {**daemon.replies["teaching"]["step"], "words": "put the tip on P9"}
    daemon.replies["teaching"] = {**daemon.replies["teaching"], "version": "v2", "step": step}
    for one in (page, other):
        until(lambda one=one: "P9" in one.locator(".step").inner_text())
    press(other, "SPIN")
    until(lambda: daemon.given)
    assert daemon.given == [("spin", {"version": "v2"})]
    other.close()
