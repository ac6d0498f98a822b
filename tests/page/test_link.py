"""The page's link says how old everything is, and sends no command without a link."""

import asyncio
import json
import math
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from fakes.testing import ManualClock
from tests.page.daemon import JPEG, PaperDaemon
from vgrd.clock import SystemClock
from vgrd.errors import ControlError
from vgrd.page.link import POLLS, STALE_S, Heard, Link
from vgrd.page.server import frame
from vgrd.page.visitor import Seen

PATIENCE_S = 20.0


@pytest.fixture
def daemon(tmp_path):
    with PaperDaemon(tmp_path) as daemon:
        yield daemon


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():  # noqa: ASYNC110  it waits for another thread
            await asyncio.sleep(0.01)


def followed(tmp_path, work: Callable[[Link], Coroutine[Any, Any, Any]]) -> Any:
    async def run() -> Any:
        link = Link(tmp_path, SystemClock())
        following = asyncio.create_task(link.follow())
        try:
            return await work(link)
        finally:
            following.cancel()
            await asyncio.wait([following])

    return asyncio.run(run())


def test_what_was_never_heard_is_stale(tmp_path):
    link = Link(tmp_path, SystemClock())
    assert not link.is_alive
    with pytest.raises(ControlError, match="nothing was sent"):
        asyncio.run(link.command("touch", "somebody", target="P1"))


def test_it_ages_as_soon_as_the_cell_says_nothing_and_sends_nothing_then(daemon, tmp_path):
    async def work(link: Link) -> None:
        await until(lambda: link.is_alive and bool(link.reply("teaching")))
        assert (await link.command("touch", "anna", target="P1", version="v1"))["sample"] == 7
        daemon.freeze()
        await until(lambda: not link.is_alive)
        with pytest.raises(ControlError, match="no link"):
            await link.command("touch", "anna", target="P1", version="v1")
        daemon.thaw()
        await until(lambda: link.is_alive)

    followed(tmp_path, work)
    assert daemon.given == [("touch", {"target": "P1", "version": "v1"})]


def test_a_gate_that_stands_still_ages_what_the_cell_tells(daemon, tmp_path):
    async def work(link: Link) -> float:
        await until(lambda: link.is_alive)
        daemon.replies["registers"]["age_s"] = 5.0
        await until(lambda: not link.is_alive)
        return link.age_s

    assert followed(tmp_path, work) >= 5.0 > STALE_S


def test_a_refusal_is_told_in_the_daemons_words(daemon, tmp_path):
    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        with pytest.raises(ControlError, match="tag A is not in the picture"):
            await link.command("look", "anna", version="v1")
        with pytest.raises(ControlError, match="somebody did something else") as refused:
            await link.command("spin", "anna", version="v0")
        assert refused.value.error == "StaleVersion"

    followed(tmp_path, work)
    assert daemon.given == []


def test_a_press_that_comes_late_is_not_obeyed(daemon, tmp_path):
    """The server hung while the person took the arm elsewhere."""

    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        for pressed_s in (link.now_s - 3.0, math.nan):
            with pytest.raises(ControlError, match="press again"):
                await link.command("touch", "anna", pressed_s, target="P1", version="v1")
        await link.command("touch", "anna", link.now_s - 1.0, target="P2", version="v1")

    followed(tmp_path, work)
    assert daemon.given == [("touch", {"target": "P2", "version": "v1"})]


@pytest.mark.parametrize("sent", ["", "[]", '["v1"]', '["v1", "x"]', "[1, null]", "{}", None])
def test_a_press_that_cannot_be_read_is_of_long_ago(sent):
    assert Seen.of(sent).at_s == 0.0


def test_pictures_are_fetched_only_while_somebody_looks_and_once_for_all(daemon, tmp_path):
    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        assert "picture" not in daemon.asked
        first, second = await asyncio.gather(link.newest_picture(-1), link.newest_picture(-1))
        assert first is second
        assert first.jpeg == JPEG
        daemon.frame = 2
        assert (await link.newest_picture(1)).facts["frame"] == 2

    followed(tmp_path, work)


def test_the_diary_is_followed_where_nobody_looks_at_pictures(daemon, tmp_path):
    async def work(link: Link) -> None:
        await until(lambda: "diary" in link.heard)
        assert "scene" not in daemon.asked

    followed(tmp_path, work)


@pytest.mark.parametrize("op", ["trials", "teaching", "result", "registers"])
def test_what_is_refused_is_not_shown_any_more_and_the_words_are(daemon, tmp_path, op):
    daemon.replies["trials"] = {"verdict": "go", "words": "2 verifications"}

    async def work(link: Link) -> None:
        await until(lambda: bool(link.reply(op)) and not link.trouble(op))
        daemon.refused[op] = "no calibration is in use"
        await until(lambda: not link.reply(op))
        assert link.trouble(op) == "no calibration is in use"
        del daemon.refused[op]
        await until(lambda: bool(link.reply(op)) and not link.trouble(op))

    followed(tmp_path, work)


@pytest.mark.parametrize("op", sorted(POLLS.keys() - {"registers", "scene"}))
def test_what_was_not_told_for_long_is_not_shown_any_more(tmp_path, op):
    """The registers are shown grey then; of the drawing see where nobody looks."""
    clock = ManualClock()
    link = Link(tmp_path, clock)
    assert link.trouble(op)
    link.heard[op] = Heard(link.now_s, {"what": "it was"})
    clock.now_s += POLLS[op].limit_s + POLLS[op].period_s
    assert (link.reply(op), link.trouble(op)) == ({"what": "it was"}, "")
    clock.now_s += 3 * POLLS[op].period_s
    assert not link.reply(op)
    assert "has not told this for" in link.trouble(op)


def test_an_operation_that_hangs_keeps_no_other_from_being_heard(daemon, tmp_path):
    daemon.held |= {"answers", "diary"}

    async def work(link: Link) -> None:
        others = POLLS.keys() - daemon.held - {"scene"}
        await until(lambda: others <= link.heard.keys())
        told_s = {op: link.heard[op].told_s for op in others}
        await until(lambda: all(link.heard[op].told_s > told_s[op] for op in others))
        assert not daemon.held & link.heard.keys()
        daemon.held.clear()

    followed(tmp_path, work)


def test_the_page_stays_fresh_however_many_commands_wait(daemon, tmp_path):
    """More than there are threads in a pool of a small computer."""
    daemon.held.add("touch")

    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        pressed = [
            asyncio.create_task(link.command("touch", f"visitor {i}", version="v1"))
            for i in range(40)
        ]
        heard = link.heard["registers"]
        for _ in range(3):
            await until(lambda seen=heard: link.heard["registers"] is not seen)  # type: ignore[misc]
            heard = link.heard["registers"]
        daemon.held.clear()
        await asyncio.gather(*pressed)

    followed(tmp_path, work)


def test_a_second_press_while_one_is_under_way_is_told_and_not_sent(daemon, tmp_path):
    daemon.held.add("touch")

    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        first = asyncio.create_task(link.command("touch", "anna", version="v1"))
        await asyncio.sleep(0)
        with pytest.raises(ControlError, match="still busy with touch"):
            await link.command("spin", "anna", version="v1")
        await link.command("spin", "ben", version="v1")
        daemon.held.clear()
        await first
        await link.command("undo", "anna", version="v1")

    followed(tmp_path, work)
    assert [op for op, _ in daemon.given] == ["spin", "touch", "undo"]


def test_a_refused_command_is_under_way_no_more(daemon, tmp_path):
    async def work(link: Link) -> None:
        await until(lambda: link.is_alive)
        for _ in range(2):
            with pytest.raises(ControlError, match="tag A is not in the picture"):
                await link.command("look", "anna", version="v1")

    followed(tmp_path, work)


@pytest.mark.parametrize(("period_s", "old_ms"), [(0.1, 2000), (1.0, 3000)])
def test_a_picture_says_how_old_it_is_and_may_be(daemon, tmp_path, period_s, old_ms):
    daemon.taken_unix_s -= 60.0
    daemon.period_s = period_s

    async def work(link: Link) -> dict[str, Any]:
        await until(lambda: link.is_alive)
        reply = await frame(link, -1)
        return dict(json.loads(reply.headers["X-Facts"]))

    told = followed(tmp_path, work)
    assert 60e3 <= told["age_ms"] < 60e3 + 1e3 * PATIENCE_S
    assert told["old_ms"] == old_ms  # a cell that takes few pictures is no worse for it
