"""The page over TLS, with a password: anybody may look, commands need a log-in, and end with it."""

import subprocess
import urllib.error
from shutil import which

import pytest

from tests.page.browser import PageProcess, browser, need_browser, open_page, press, tab, until
from tests.page.daemon import PaperDaemon
from tests.page.test_browser import grave_faults
from vgrd.page import texts
from vgrd.page.access.password import Password

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

PASSWORD = "a horse, a battery"  # noqa: S105  of this test


@pytest.fixture(scope="module")
def terms(tmp_path_factory):
    """A certificate that this computer signs itself, and the file of the password."""
    pytest.importorskip("nicegui", reason="the extra `page` is not installed")
    if which("openssl") is None:
        pytest.skip("openssl, which makes the certificate, is not installed")
    folder = tmp_path_factory.mktemp("keys")
    certificate, key = str(folder / "page.crt"), str(folder / "page.key")
    ask = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2"
    subprocess.run(
        [*ask.split(), "-subj", "/CN=127.0.0.1", "-keyout", key, "-out", certificate],
        check=True,
        capture_output=True,
    )
    Password.made_of(PASSWORD).save(folder / "password")
    files = {"certificate": certificate, "key": key, "password_file": str(folder / "password")}
    return {"names": ["cell1.plant.lan"], **files}


@pytest.fixture
def daemon(tmp_path):
    with PaperDaemon(tmp_path) as daemon:
        yield daemon


@pytest.fixture
def server(daemon, tmp_path, terms):
    with PageProcess(tmp_path, terms) as server:
        yield server


def log_in(page, word: str) -> None:
    press(page, texts.LOG_IN)
    page.get_by_label(texts.PASSWORD).fill(word)
    press(page, texts.ENTER)


def touch(page) -> None:
    tab(page, "Teach")
    press(page, "TOUCH")


def test_who_is_not_logged_in_may_only_look(server, daemon):
    need_browser()
    with browser() as opened:
        page = open_page(opened, server.url, ignore_https_errors=True)
        assert page.locator(".state .word").inner_text() == "● READY"
        touch(page)
        until(lambda: page.get_by_text("log in first").count(), "the refusal")
        log_in(page, "not the password")
        until(lambda: page.get_by_text(texts.WRONG_PASSWORD).count(), "the second refusal")
        assert daemon.given == []

        page.get_by_label(texts.PASSWORD).fill(PASSWORD)
        page.keyboard.press("Enter")
        until(lambda: page.get_by_text("You may command").is_visible(), "the session")
        touch(page)
        until(lambda: len(daemon.given) == 1, "the command")

        stranger = open_page(opened, server.url, ignore_https_errors=True)
        touch(stranger)
        until(
            lambda: stranger.get_by_text("log in first").count(), "the refusal of another browser"
        )
        assert len(daemon.given) == 1

        page.reload()
        until(lambda: page.get_by_text("You may command").count(), "the session of before")
        touch(page)
        until(lambda: len(daemon.given) == 2, "the command after a reload")

        press(page, texts.LOG_OUT)
        until(lambda: page.get_by_text(texts.MAY_VIEW).is_visible(), "the end")
        touch(page)
        until(lambda: page.get_by_text("log in first").count(), "the last refusal")
        assert len(daemon.given) == 2
        (cookie,) = page.context.cookies()
        assert (cookie["httpOnly"], cookie["secure"], cookie["sameSite"]) == (True, True, "Strict")
        assert page.faults == []
    for word in ("wrong_password", "logged_in", "logged_out", "command_refused"):
        assert word in server.log
    assert PASSWORD not in server.log
    assert "not the password" not in server.log
    assert "Traceback" not in server.log


def test_everybody_can_read_the_dialog(server):
    need_browser()
    with browser() as opened:
        for theme in ("light", "dark"):
            page = open_page(opened, server.url, ignore_https_errors=True, color_scheme=theme)
            press(page, texts.LOG_IN)
            until(page.get_by_label(texts.PASSWORD).is_visible)
            until(lambda page=page: grave_faults(page) == [], "a page without grave faults")
            page.close()


def test_tls_is_kept_to_and_names_are_those_of_the_cell_file(server):
    with server.asked("pulse", Host=f"cell1.plant.lan:{server.port}") as reply:
        assert "max-age" in reply.headers["Strict-Transport-Security"]
        assert reply.headers["Set-Cookie"] is None
    for headers in (
        {"Host": f"cell2.plant.lan:{server.port}"},
        {"Origin": "https://evil.example"},
        {"Origin": f"http://127.0.0.1:{server.port}"},
    ):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            server.asked("pulse", **headers)
