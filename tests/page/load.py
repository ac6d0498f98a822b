"""Whether robots notice the page: `python -m tests.page.load [--seconds 20]`.

Reads of the whole response of a real gate beside four viewers of the page, and without them, by turns.
"""

import argparse
import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

from fakes.cell.cell import FakeCell
from fakes.cell.daemon import Daemon
from fakes.testing import free_port
from fakes.world.layout import Layout
from fakes.world.world import World
from vgrd.orphans import dying_with_us

VIEWERS = 4
PULSE_S = 0.1  # as `assets/watchdog.js`
TURNS = 3  # of both kinds
_READ_S = 0.02  # of a robot that polls fast
_WORDS, _FIRST = 68, 100  # all of the response


def main() -> int:
    """Measure and print; or view, as one of the processes that this one starts."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--seconds", type=float, default=20.0, help="of each turn")
    given.add_argument("--view", default="", help="address of a page to look at, until killed")
    options = given.parse_args()
    if options.view:
        _view(options.view)
    with tempfile.TemporaryDirectory() as folder:
        page = free_port()
        world = World(Layout(), 1)
        with (
            FakeCell(world, Path(folder), free_port(), page=page) as cell,
            Daemon(cell.cell_file, Path(folder) / "vgrd.log") as daemon,
        ):
            daemon.wait_until(lambda status: status["robot"] == status["camera"] == "ok")
            _compare(cell.port, f"http://127.0.0.1:{page}/", options.seconds)
    return 0


def _compare(port: int, url: str, seconds: float) -> None:
    alone, beside = [], []
    for _ in range(TURNS):
        alone += _read(port, seconds)
        with subprocess.Popen(
            dying_with_us([sys.executable, "-m", "tests.page.load", "--view", url])
        ) as viewers:
            time.sleep(3.0)
            beside += _read(port, seconds)
            viewers.kill()
    for name, times in (("alone", alone), (f"beside {VIEWERS} viewers", beside)):
        middle, late = (1e3 * sorted(times)[int(share * len(times))] for share in (0.5, 0.99))
        print(f"registers {name}: {middle:.2f} ms, 99 of 100 {late:.2f} ms, {len(times)} reads")
    ratio = sorted(beside)[int(0.99 * len(beside))] / sorted(alone)[int(0.99 * len(alone))]
    print(f"ratio of the 99 %: {ratio:.2f}")


def _read(port: int, seconds: float) -> list[float]:
    """Round trips, s; every reply is whole and of this request."""
    times = []
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as link:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        end_s = time.monotonic() + seconds
        number = 0
        while time.monotonic() < end_s:
            number = (number + 1) & 0xFFFF
            start_s = time.perf_counter()
            link.sendall(struct.pack(">HHHBBHH", number, 0, 6, 1, 4, _FIRST, _WORDS))
            reply = b""
            while len(reply) < 9 + 2 * _WORDS:
                reply += link.recv(1024)
            times.append(time.perf_counter() - start_s)
            assert struct.unpack(">H", reply[:2]) == (number,)
            time.sleep(_READ_S)
    return times


def _view(url: str) -> None:
    """Ask what the scripts of four browsers ask, until killed; they would run on other computers."""
    os.nice(19)

    def pulse() -> None:
        while True:
            with suppress(OSError), urllib.request.urlopen(f"{url}pulse", timeout=5.0) as reply:  # noqa: S310  loopback
                reply.read()
            time.sleep(PULSE_S)

    def look() -> None:
        frame = -1
        while True:
            with (
                suppress(OSError),
                urllib.request.urlopen(f"{url}frame?after={frame}", timeout=5.0) as reply,  # noqa: S310  loopback
            ):
                reply.read()
                frame += 1

    watching = [threading.Thread(target=one) for _ in range(VIEWERS) for one in (pulse, look)]
    for thread in watching:
        thread.start()
    for thread in watching:
        thread.join()


if __name__ == "__main__":
    sys.exit(main())
