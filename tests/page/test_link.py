"""The page's link says how old everything is, and sends no command without a link."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from tests.page.daemon import JPEG, PaperDaemon
from vgrd.clock import SystemClock
from vgrd.errors import ControlError
from vgrd.page.link import STALE_S, Link
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
        with pytest.raises(ControlError, match="press again"):
            await link.command("touch", "anna", link.now_s - 3.0, target="P1", version="v1")
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
        await until(lambda: "diary" in link.heard.replies)
        assert "scene" not in daemon.asked

    followed(tmp_path, work)
