"""Figures of the page, measured in a real browser: `python -m tests.page.figures [--seconds 20]`.

Time to grey after each part froze, picture to screen, processor and memory of the page's process.
"""

import argparse
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fakes.cell.memory import pss_mib
from tests.page.browser import PageProcess, browser, is_grey, open_page, until
from tests.page.daemon import PaperDaemon, teaching

FRAMES_S = 10.0  # pictures a second
SIZE = (773, 1024)  # of a picture, as the daemon makes them


def main() -> int:
    """Measure and print."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--seconds", type=float, default=20.0)
    given.add_argument("--browsers", type=int, default=4)
    given.add_argument("--soak", type=float, default=0.0, help="minutes of use before it ends")
    options = given.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        with PaperDaemon(place) as daemon, PageProcess(place) as server, browser() as opened:
            page = open_page(opened, server.url)
            for name, (freeze, thaw) in _freezers(daemon, server, page).items():
                times = [_to_grey(page, freeze, thaw) for _ in range(5)]
                print(
                    f"grey after the {name} froze: {min(times):.2f} to {max(times):.2f} s (bar 1)"
                )
            others = [open_page(opened, server.url) for _ in range(options.browsers - 1)]
            _film(daemon, server, page, options.seconds)
            print(
                f"memory, {options.browsers} browsers: {pss_mib(server.process.pid):.0f} MiB (bar 250)"
            )
            _soak(daemon, server, options.soak)
            for other in others:
                other.close()
    return 0


def _soak(daemon: PaperDaemon, server: PageProcess, minutes: float) -> None:
    """Two pictures and a changed session a second, with the memory every few minutes."""
    start_s, told_s = time.monotonic(), -1e9
    noise = np.random.default_rng(0)
    while (used_s := time.monotonic() - start_s) < 60 * minutes:
        for _ in range(2):
            grey = cv2.blur(noise.integers(60, 190, SIZE, np.uint8), (5, 5))
            daemon.show(cv2.imencode(".jpg", grey)[1].tobytes())
            time.sleep(0.5)
        daemon.replies["teaching"] = {**teaching(), "version": f"v{used_s:.0f}"}
        if used_s - told_s >= 60 * min(5.0, minutes / 4):
            told_s = used_s
            print(
                f"memory after {used_s / 60:.0f} min: {pss_mib(server.process.pid):.0f} MiB",
                flush=True,
            )


def _freezers(
    daemon: PaperDaemon, server: PageProcess, page: Any
) -> dict[str, tuple[Callable[[], Any], Callable[[], Any]]]:
    return {
        "cell": (daemon.freeze, daemon.thaw),
        "page's server": (server.freeze, server.thaw),
        "gate": (lambda: daemon.age_gate(on=True), lambda: daemon.age_gate(on=False)),
        "websocket": (lambda: page.evaluate(_DEAFEN), lambda: page.evaluate(_HEAR)),
    }


def _to_grey(page: Any, freeze: Callable[[], Any], thaw: Callable[[], Any]) -> float:
    """Seconds from the freeze to the grey page, as the browser sees it."""
    freeze()
    start_s = time.monotonic()
    page.wait_for_function("document.body.classList.contains('stale')", polling=10)
    took_s = time.monotonic() - start_s
    thaw()
    until(lambda: not is_grey(page))
    return took_s


def _film(daemon: PaperDaemon, server: PageProcess, page: Any, seconds: float) -> None:
    """Show pictures at a rate, and tell how late each was on the screen; the page's own processor time beside."""
    over = threading.Event()

    def show() -> None:
        noise = np.random.default_rng(0)
        grey = noise.integers(60, 190, SIZE, np.uint8)
        while not over.wait(1 / FRAMES_S):
            grey = np.roll(grey, 7, axis=1)
            daemon.show(cv2.imencode(".jpg", cv2.blur(grey, (5, 5)))[1].tobytes())

    filming = threading.Thread(target=show)
    filming.start()
    try:
        time.sleep(2.0)
        start_s, used_s = time.monotonic(), _processor_s(server.process.pid)
        late_ms = page.evaluate(_LATENESS, 1e3 * seconds)
        share = (_processor_s(server.process.pid) - used_s) / (time.monotonic() - start_s)
    finally:
        over.set()
        filming.join()
    ordered = sorted(late_ms)
    print(
        f"picture to screen: {ordered[len(ordered) // 2]:.0f} ms, 95 of 100 {ordered[int(0.95 * len(ordered))]:.0f} ms "
        f"(bar 120), {len(ordered) / seconds:.1f} pictures a second"
    )
    print(f"processor of the page's process: {100 * share:.0f} % of a core (bar 10)")


_DEAFEN = "() => { window.socket.onevent = () => {}; }"
_HEAR = "() => { delete window.socket.onevent; }"
_LATENESS = """span_ms => new Promise(done => {
    const image = document.querySelector(".live"), late = [];
    const seen = new MutationObserver(() => late.push(image.dataset.shown - image.dataset.taken));
    seen.observe(image, { attributes: true, attributeFilter: ["data-shown"] });
    setTimeout(() => { seen.disconnect(); done(late); }, span_ms);
})"""


def _processor_s(pid: int) -> float:
    """User and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100  # clock ticks of Linux


if __name__ == "__main__":
    sys.exit(main())
