"""A page that cannot be shown says so in its health, which the gate and `vgrd status` tell, with the remedy."""

import socket

import pytest

from vgrd.errors import ServingError
from vgrd.ipc.health import HEALTH_KIND, Health, health_path
from vgrd.ipc.ring import RingReader
from vgrd.page import __main__ as page


@pytest.fixture(autouse=True)
def _as_a_guest(monkeypatch) -> None:
    """It runs in the process of the tests: their log and their priority stay as they are."""
    monkeypatch.setattr(page.logs, "configure", lambda _: None)
    monkeypatch.setattr(page, "give_way", lambda: None)


def told(runtime_dir) -> Health:
    with RingReader.open(health_path(runtime_dir, "page"), HEALTH_KIND) as ring:
        return Health.unpack(ring.newest().payload)


def test_without_its_package(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "find_spec", lambda _: None)
    assert page.main(tmp_path, "127.0.0.1", 1) == ServingError.exit_code
    health = told(tmp_path)
    assert health.state == "refused"
    assert "pip install 'vgrd[page]'" in health.detail


def test_at_a_port_that_is_taken(tmp_path):
    pytest.importorskip("nicegui", reason="the extra `page` is not installed")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert page.main(tmp_path, "127.0.0.1", port) == ServingError.exit_code
    assert "change [page] host or port" in told(tmp_path).detail
