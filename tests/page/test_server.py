"""Who asks the page under another name, or from another page, gets nothing; what is sent is guarded by headers."""

import asyncio
import json
import math
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from tests.page.daemon import PaperDaemon
from vgrd.clock import SystemClock
from vgrd.page.link import Link
from vgrd.page.server import OnlyHere, names_of, picture_in_words, pulse, report

HOST = "127.0.0.1:8080"
Headers = dict[str, str]


class Asked:
    """What our guard lets through to the page behind it, and what it answers by itself."""

    def __init__(self, kind: str, headers: Headers) -> None:
        self.reached = False
        self.sent: list[dict[str, Any]] = []
        raw = [(k.lower().encode(), v.encode()) for k, v in {"Host": HOST, **headers}.items()]
        scope = {"type": kind, "path": "/", "headers": raw, "method": "GET"}
        guard = OnlyHere(self._page, names_of("127.0.0.1", 8080))
        asyncio.run(guard(scope, self._receive, self._send))

    @property
    def headers(self) -> Headers:
        """Of the answer."""
        return {k.decode(): v.decode() for k, v in self.sent[0]["headers"]}

    async def _page(self, scope: Any, receive: Any, send: Any) -> None:
        self.reached = True
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})

    async def _receive(self) -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def _send(self, message: dict[str, Any]) -> None:
        self.sent.append(message)


@pytest.mark.parametrize("host", [HOST, "localhost:8080"])
def test_our_own_page_is_served_with_its_headers(host):
    asked = Asked("http", {"Host": host, "Origin": f"http://{host}"})
    assert asked.reached
    headers = asked.headers
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-frame-options"] == "DENY"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example:8080"},  # a name that was made to lead here (DNS rebinding)
        {"Host": "127.0.0.1:8081"},
        {"Host": ""},
        {"Origin": "http://evil.example"},  # another page of the same browser
        {"Origin": "http://localhost:8080"},  # as another page: the host is 127.0.0.1
        {"Origin": "null"},
        {"Origin": ""},
    ],
)
def test_others_get_nothing_by_http_and_by_websocket(headers):
    asked = Asked("http", headers)
    assert not asked.reached
    assert asked.sent[0]["status"] == 403
    asked = Asked("websocket", headers)
    assert not asked.reached
    assert asked.sent == [{"type": "websocket.close", "code": 1008}]


def test_our_own_websocket_is_open():
    assert Asked("websocket", {"Origin": f"http://{HOST}"}).reached


def test_an_address_of_ip_6_is_written_as_browsers_do():
    assert "[::1]:8080" in names_of("::1", 8080)


def test_the_pulse_is_a_number_even_before_anything_was_heard(tmp_path):
    told = json.loads(bytes(pulse(Link(tmp_path, SystemClock())).body))
    assert math.isfinite(told["age_ms"])
    assert told["age_ms"] > 60_000


def test_a_picture_is_told_in_words():
    tags = {"a": {"wanted": "36h11 id 0", "corners": None}}
    words = picture_in_words({"tags": tags, "robot_at_rest": False})
    assert words == "tag A (36h11 id 0) not seen; arm moves"
    small = {"wanted": "36h11 id 0", "corners": [[0, 0], [9, 0], [9, 9], [0, 9]], "fit_px": 0.08}
    told = [
        picture_in_words({"tags": {"b": {**small, "side_px": side}}, "robot_at_rest": True})
        for side in (90, 36)
    ]
    near, far = told
    assert near == "tag B (36h11 id 0) seen, 90 px, fits to 0.08 px; arm at rest"
    assert "36 px (small" in far


def test_nobody_waits_in_vain_for_a_picture_that_does_not_come(tmp_path):
    link = Link(tmp_path, SystemClock())
    assert asyncio.run(link.newest_picture(3)) is None


def test_a_report_is_passed_on_and_a_refusal_is_told(tmp_path):
    with PaperDaemon(tmp_path):
        link = Link(tmp_path, SystemClock())
        good, bad = (asyncio.run(report(link, name)) for name in ("one", "missing"))
    assert (good.status_code, good.media_type) == (200, "text/html")
    assert b"Calibration report" in bytes(good.body)
    assert (bad.status_code, bytes(bad.body)) == (404, b"no such session")
