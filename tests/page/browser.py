"""A headless Chromium, and the page's process, for the tests that look at both."""

import json
import os
import signal
import ssl
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import which
from typing import Any, Self

import pytest

from fakes.testing import free_port
from vgrd.orphans import dying_with_us

CHROMIUM = which("chromium")
PATIENCE_S = 60.0
_FLAGS = [  # as root in a container; and nothing that asks hosts of its own
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def need_browser() -> None:
    """Skip where there is none; CI installs it."""
    pytest.importorskip("nicegui", reason="the extra `page` is not installed")
    pytest.importorskip("playwright", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is not installed (Debian: package chromium)")


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium until the end of the `with`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
        try:
            yield opened
        finally:
            opened.close()


class PageProcess:
    """`python -m vgrd.page` on a runtime folder; killed at the end of the `with`."""

    def __init__(self, runtime_dir: Path, terms: Mapping[str, object] | None = None) -> None:
        self.port, self._terms = free_port(), dict(terms or {})
        self._argv = [sys.executable, "-m", "vgrd.page", str(runtime_dir), "127.0.0.1"]
        self._log = runtime_dir / "page.log"

    @property
    def url(self) -> str:
        """Where browsers find it."""
        scheme = "https" if self._terms.get("certificate") else "http"
        return f"{scheme}://127.0.0.1:{self.port}/"

    @property
    def log(self) -> str:
        """What it has written."""
        return self._log.read_text()

    def __enter__(self) -> Self:
        # The page's framework takes this for a test of its own kind.
        env = {name: text for name, text in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                dying_with_us([*self._argv, str(self.port), json.dumps(self._terms)]),
                stderr=log,
                env=env,
            )
        until(self._answers)
        return self

    def _answers(self) -> bool:
        assert self.process.poll() is None, self.log
        with suppress(OSError), self.asked("pulse"):
            return True
        return False

    def asked(self, path: str, **headers: str) -> Any:
        """The reply to a request of no browser, whoever signed its certificate. Raises HTTPError, an OSError."""
        anybody = ssl.create_default_context()
        anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
        request = urllib.request.Request(f"{self.url}{path}", headers=headers)  # noqa: S310  loopback
        return urllib.request.urlopen(request, timeout=5.0, context=anybody)  # noqa: S310  idem

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGCONT)
        self.process.kill()
        self.process.wait()

    def freeze(self) -> None:
        """Stop it, as a hang would."""
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        self.process.send_signal(signal.SIGCONT)


def until(is_so: Callable[[], object], what: str = "it", within_s: float = PATIENCE_S) -> None:
    """Wait until something is so; a busy machine takes its time."""
    end_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < end_s, f"{what} never came"
        time.sleep(0.02)


def open_page(opened: Any, url: str, **options: Any) -> Any:
    """A page that has a link, with what went wrong on it in `page.faults`, whom it asked in `page.hosts`."""
    page = opened.new_page(viewport={"width": 1280, "height": 800}, **options)
    page.set_default_timeout(1e3 * PATIENCE_S)
    page.faults, page.hosts = [], set()
    page.on("console", lambda one: page.faults.append(one.text) if one.type == "error" else None)
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("request", lambda one: page.hosts.add(one.url.split("/")[2]))
    for _ in range(3):  # a busy machine needs longer than the page's framework waits
        try:
            page.goto(url)
            page.wait_for_selector("header.state .word:not(:empty)", timeout=1e3 * PATIENCE_S / 3)
            break
        except Exception as error:  # noqa: BLE001  playwright is imported only where it is
            last = error
    else:
        raise last
    until(lambda: not is_grey(page))
    return page


def is_grey(page: Any) -> bool:
    """Whether it says that nothing on it is valid."""
    return bool(page.evaluate("document.body.classList.contains('stale')"))


def tab(page: Any, name: str) -> None:
    """Go to a tab, and wait until it is there."""
    page.get_by_role("tab", name=name).click()
    page.locator(f"[data-tab={name.lower()}]").wait_for(state="visible")


def press(page: Any, name: str) -> None:
    """Press a button."""
    page.get_by_role("button", name=name, exact=True).click()
