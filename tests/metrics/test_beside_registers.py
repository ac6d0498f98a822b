"""The process of the metrics beside a real gate: it tells what that counts, and a flood of it changes no register."""

import contextlib
import socket
import sys
import threading

import pytest
from prometheus_client.parser import text_string_to_metric_families

from fakes.testing import free_port
from tests.gate.process.gate_process import GateProcess, ask, cell, see, until
from vgrd.registers import Status

pytestmark = pytest.mark.system

RIGHT = b"GET /metrics HTTP/1.1\r\n\r\n"
READS = 300


def scrape(port: int) -> bytes:
    """One answer; what came of it where it was dropped."""
    with (
        contextlib.suppress(OSError),
        socket.create_connection(("127.0.0.1", port), timeout=5.0) as link,
    ):
        link.sendall(RIGHT)
        received = b""
        while chunk := link.recv(65536):
            received += chunk
        return received
    return b""


def told(port: int) -> dict[str, float]:
    body = until(lambda: scrape(port)).split(b"\r\n\r\n")[1].decode()
    families = text_string_to_metric_families(body)
    return {sample.name: sample.value for family in families for sample in family.samples}


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def gate(tmp_path, port):
    argv = [sys.executable, "-m", "vgrd.metrics", str(tmp_path), "127.0.0.1", str(port)]
    row = {"name": "metrics", "kind": "metrics", "argv": argv, "hang_s": 5.0}
    with GateProcess(tmp_path, [cell(tmp_path), row]) as running:
        yield running


def test_what_the_gate_counts_is_told(gate, port) -> None:
    with gate.client() as client:
        for _ in range(10):
            see(client)
        until(lambda: told(port).get("vgrd_server_requests_total", 0) >= 10)
    assert until(lambda: told(port).get("vgrd_process_up") == 1.0)
    assert told(port)["vgrd_cell_up"] == 0.0  # the cell of this test has no control socket


def test_a_flood_of_scrapes_changes_no_register(gate, port) -> None:
    until(lambda: scrape(port))
    over = threading.Event()

    def flood() -> None:
        while not over.is_set():
            scrape(port)

    knocking = [threading.Thread(target=flood) for _ in range(4)]
    with gate.client() as client:
        until(lambda: see(client)["STATUS"] == Status.IDLE)
        ask(client, 7, 1)
        until(lambda: see(client)["STATUS"] == Status.OK)
        before = see(client)
        for thread in knocking:
            thread.start()
        try:
            seen = [see(client) for _ in range(READS)]
        finally:
            over.set()
            for thread in knocking:
                thread.join()
    moving = ("HB", "AGE", "TCAP")
    still = {name: value for name, value in before.items() if not name.startswith(moving)}
    for registers in seen:
        assert {name: registers[name] for name in still} == pytest.approx(still, nan_ok=True)
    assert gate.row("metrics").starts == 1
    assert gate.row("cell").starts == 1


def test_scrapers_that_never_read_nor_end_cost_the_registers_nothing(gate, port) -> None:
    until(lambda: scrape(port))
    with contextlib.ExitStack() as links, gate.client() as client:
        until(lambda: see(client)["STATUS"] == Status.IDLE)
        for request in (RIGHT, b"GET", b""):
            for _ in range(4):
                link = links.enter_context(socket.socket())
                link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                link.connect(("127.0.0.1", port))
                link.sendall(request)
        ask(client, 7, 1)
        until(lambda: see(client)["STATUS"] == Status.OK)
        seen = [see(client) for _ in range(READS)]
    assert all(registers["STATUS"] == Status.OK for registers in seen)
    assert gate.row("metrics").starts == 1
    assert told(port)["vgrd_process_up"] == 1.0


def test_a_port_that_is_taken_costs_nothing_but_the_metrics(gate, port, tmp_path) -> None:
    taken = free_port()
    argv = [sys.executable, "-m", "vgrd.metrics", str(tmp_path / "b"), "127.0.0.1", str(taken)]
    row = {"name": "metrics", "kind": "metrics", "argv": argv, "hang_s": 5.0}
    with (
        socket.create_server(("127.0.0.1", taken)),
        GateProcess(tmp_path / "b", [cell(tmp_path / "b"), row]) as other,
        other.client() as client,
    ):
        until(lambda: other.row("metrics").exit_code == 69)
        until(lambda: see(client)["STATUS"] == Status.IDLE)
        assert other.row("cell").starts == 1
