"""Password, sessions, lock-out and limits of the page, by clocks that the tests turn."""

import asyncio
import json
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the extra `page` is not installed")

from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved, save_resolved
from vgrd.config.setup import process_table
from vgrd.errors import ControlError, InputError, ServingError
from vgrd.page.access import doors
from vgrd.page.access.buckets import Buckets
from vgrd.page.access.doors import COOKIE, MOST, PAGE_COST, RATE_HZ, Doors
from vgrd.page.access.guard import (
    ALL_MISSES,
    FREE_MISSES,
    IDLE_S,
    LONGEST_S,
    LONGEST_WAIT_S,
    Guard,
    LockOut,
    Sessions,
)
from vgrd.page.access.password import LONGEST, SHORTEST, Password
from vgrd.page.access.terms import Terms

WORD = "a horse, a battery"
EXAMPLE = Path(__file__).parents[2] / "config" / "cell.example.toml"


class TurnedClock:
    """Stands until a test turns it."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def wall(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock():
    return TurnedClock()


@pytest.fixture
def file(tmp_path):
    Password.made_of(WORD).save(tmp_path / "password")
    return tmp_path / "password"


# the file


def test_the_file_is_its_owners_and_holds_no_password(file):
    file.chmod(0o600)
    password = Password.read(file)
    assert password.fits(WORD)
    assert not any(password.fits(other) for other in ("", WORD[:-1], WORD + " ", WORD.upper()))
    assert WORD not in file.read_text()
    assert WORD not in repr(password)
    assert [one.name for one in file.parent.iterdir()] == [file.name]  # no draft is left


def test_two_files_of_one_password_have_nothing_in_common(file):
    assert Password.made_of(WORD).key != Password.read(file).key


def test_a_file_that_was_open_is_closed_when_it_is_written(file):
    file.chmod(0o644)
    Password.made_of(WORD).save(file)
    assert file.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o620, 0o666])
def test_a_file_that_others_may_use_is_refused(file, mode):
    file.chmod(mode)
    with pytest.raises(InputError, match=f"mode {mode:04o}.*chmod 600"):
        Password.read(file)


@pytest.mark.parametrize("text", ["", "scrypt$1$8$1$00$00", WORD, "é", "scrypt$" * 9999])
def test_what_is_no_hash_is_refused_with_the_remedy(file, text):
    file.write_text(text)
    with pytest.raises(InputError, match=r"holds no line.*vgrd page-password"):
        Password.read(file)


def test_a_file_that_is_not_there_is_told_with_the_remedy(tmp_path):
    with pytest.raises(InputError, match="vgrd page-password"):
        Password.read(tmp_path / "none")
    with pytest.raises(InputError, match="cannot be written"):
        Password.made_of(WORD).save(tmp_path / "none" / "password")


@pytest.mark.parametrize("count", [0, SHORTEST - 1, LONGEST + 1])
def test_short_and_endless_passwords_are_refused(count):
    with pytest.raises(InputError, match=f"{count} characters"):
        Password.made_of("x" * count)


def test_a_letter_with_an_accent_is_one_however_it_is_typed():
    assert Password.made_of("m\u00fcnchen m\u00fcnchen").fits("mu\u0308nchen mu\u0308nchen")


# sessions


def test_a_session_ends_without_commands(clock):
    sessions = Sessions(clock)
    sessions.begin("anna")
    clock.now_s += IDLE_S - 1
    assert sessions.use("anna")
    clock.now_s += IDLE_S - 1
    assert sessions.find("anna")  # the command prolonged it, this look does not
    clock.now_s += 2
    assert sessions.use("anna") is None


def test_a_session_ends_after_a_shift_whatever_is_done(clock):
    sessions = Sessions(clock)
    sessions.begin("anna")
    end_s = clock.now_s + LONGEST_S
    while clock.now_s < end_s:
        assert sessions.use("anna")
        clock.now_s += IDLE_S / 2
    assert sessions.use("anna") is None


def test_a_session_is_of_one_browser_until_it_logs_out(clock):
    sessions = Sessions(clock)
    anna, bert = sessions.begin("anna"), sessions.begin("bert")
    assert anna.id != bert.id
    sessions.end("anna")
    assert sessions.find("anna") is None
    assert sessions.find("bert") is bert
    assert sessions.find("") is None


# lock-out


def misses(lock_out, address: str, count: int) -> None:
    for _ in range(count):
        lock_out.count(address)


def test_five_misses_are_free_and_then_the_wait_doubles_up_to_five_minutes(clock):
    lock_out = LockOut(clock)
    misses(lock_out, "10.0.0.1", FREE_MISSES - 1)
    assert lock_out.wait_s("10.0.0.1") == 0.0
    waits = []
    for _ in range(8):
        lock_out.count("10.0.0.1")
        waits.append(lock_out.wait_s("10.0.0.1"))
        clock.now_s += waits[-1]
        assert lock_out.wait_s("10.0.0.1") == 0.0
    assert waits == [10.0, 20.0, 40.0, 80.0, 160.0, *[LONGEST_WAIT_S] * 3]
    assert lock_out.wait_s("10.0.0.2") == 0.0


def test_the_password_is_forgiven_its_misses(clock):
    lock_out = LockOut(clock)
    misses(lock_out, "10.0.0.1", FREE_MISSES)
    lock_out.forgive("10.0.0.1")
    assert lock_out.wait_s("10.0.0.1") == 0.0


def test_many_addresses_together_must_wait_too(clock):
    lock_out = LockOut(clock)
    for i in range(ALL_MISSES):
        assert lock_out.wait_s(f"10.0.0.{i}") == 0.0
        lock_out.count(f"10.0.0.{i}")
    wait_s = lock_out.wait_s("10.0.1.1")
    assert 0.0 < wait_s <= 10.0
    clock.now_s += wait_s
    assert lock_out.wait_s("10.0.1.1") == pytest.approx(0.0, abs=1e-9)


# the guard


def refused(guard: Guard, word: str, address: str = "10.0.0.1") -> str:
    with pytest.raises(ControlError) as refusal:
        asyncio.run(guard.log_in("anna", address, word))
    return str(refusal.value)


def test_commands_need_a_log_in_and_end_with_it(file, clock):
    guard = Guard(file, clock)
    with pytest.raises(ControlError, match="log in first"):
        guard.check("anna")
    assert refused(guard, "b") == "this is not the password"
    with pytest.raises(ControlError, match="log in first"):
        guard.check("anna")
    asyncio.run(guard.log_in("anna", "10.0.0.1", WORD))
    guard.check("anna")
    with pytest.raises(ControlError, match="log in first"):
        guard.check("bert")
    guard.log_out("anna", "10.0.0.1")
    with pytest.raises(ControlError, match="log in first"):
        guard.check("anna")
    guard.log_out("anna", "10.0.0.1")


def test_many_guesses_at_once_are_no_way_around_the_lock_out(file, clock):
    guard = Guard(file, clock)

    async def guess() -> list[BaseException | None]:
        tries = [guard.log_in("anna", "10.0.0.1", f"guess {i}") for i in range(12)]
        return await asyncio.gather(*tries, return_exceptions=True)

    told = [str(one) for one in asyncio.run(guess())]
    assert told.count("this is not the password") == FREE_MISSES
    assert sum("try again in 10 s" in one for one in told) == 12 - FREE_MISSES
    assert "try again" in refused(guard, WORD)  # nor is the password tried meanwhile
    asyncio.run(guard.log_in("bert", "10.0.0.2", WORD))


def test_a_new_password_counts_at_once_and_ends_the_sessions_of_the_old_one(file, clock):
    guard = Guard(file, clock)
    asyncio.run(guard.log_in("anna", "10.0.0.1", WORD))
    Password.made_of("another long word").save(file)
    asyncio.run(guard.log_in("bert", "10.0.0.2", "another long word"))
    with pytest.raises(ControlError, match="log in first"):
        guard.check("anna")
    guard.check("bert")
    file.unlink()
    assert "password file" in refused(guard, WORD)
    guard.check("bert")


# the doors


class Street:
    """Requests to our doors, as uvicorn passes them on; `reached` counts what came through."""

    def __init__(self, clock: TurnedClock) -> None:
        self.reached, self._frames = 0, 0
        self.mark = ""
        self._doors = Doors(self._page, clock)

    def ask(self, path: str = "/pulse", address: str = "10.0.0.1", cookie: str = "") -> dict:
        """The first message of the answer."""
        return self._send("http", path, address, cookie)

    def call(self, frames: int) -> int:
        """How many frames of a websocket reach the page."""
        self._frames, self.reached = frames, 0
        self._send("websocket", "/_nicegui_ws/", "10.0.0.1", "")
        return self.reached

    def _send(self, kind: str, path: str, address: str, cookie: str) -> dict:
        sent: list[dict] = []

        async def send(message: dict) -> None:
            sent.append(message)

        async def receive() -> dict:
            self._frames -= 1
            return {"type": f"{kind}.receive" if self._frames >= 0 else f"{kind}.disconnect"}

        headers = [(b"cookie", cookie.encode())] if cookie else []
        scope = {"type": kind, "path": path, "client": (address, 1), "headers": headers}
        asyncio.run(self._doors({**scope, "method": "GET"}, receive, send))
        return sent[0] if sent else {}

    async def _page(self, scope, receive, send) -> None:
        if scope["type"] == "websocket":
            while (await receive())["type"] == "websocket.receive":
                self.reached += 1
            return
        self.reached += 1
        self.mark = scope["state"]["mark"]
        await send({"type": "http.response.start", "status": 200, "headers": []})


def test_who_asks_too_much_must_wait_and_others_need_not(clock):
    street = Street(clock)
    for _ in range(int(MOST)):
        assert street.ask()["status"] == 200
    assert street.ask()["status"] == 429
    assert street.ask(address="10.0.0.2")["status"] == 200
    clock.now_s += 1.0
    assert [street.ask()["status"] for _ in range(int(RATE_HZ) + 1)].count(200) == RATE_HZ


def test_a_page_costs_more_than_a_pulse_also_one_that_is_not_there(clock):
    street = Street(clock)
    for path in ["/", "/nothing"] * int(MOST / PAGE_COST / 2):
        assert street.ask(path)["status"] == 200
    assert street.ask("/")["status"] == 429


def test_a_websocket_that_says_too_much_is_closed(clock):
    street = Street(clock)
    assert street.call(frames=10 * int(MOST)) == MOST - 1  # one to open it
    assert street.call(frames=1) == 0


def test_several_browsers_of_one_address_are_never_too_much(clock):
    street = Street(clock)
    for _ in range(4):
        street.ask("/")
    for _ in range(10):  # seconds of four browsers
        clock.now_s += 1.0
        assert {street.ask()["status"] for _ in range(4 * 30)} == {200}


def test_a_browser_is_given_one_mark_that_scripts_do_not_see(clock):
    street = Street(clock)
    headers = dict(street.ask("/")["headers"])
    cookie, *facts = headers[b"set-cookie"].decode().split("; ")
    assert set(facts) == {"Path=/", "Secure", "HttpOnly", "SameSite=Strict"}
    assert cookie == f"{COOKIE}={street.mark}"
    mark = street.mark
    headers = dict(street.ask("/", cookie=f"other=1; {cookie}")["headers"])
    assert b"set-cookie" not in headers
    assert street.mark == mark
    assert headers[b"strict-transport-security"].startswith(b"max-age=")


@pytest.mark.parametrize("mark", ["", "x", "x" * 44, "x" * 42 + "é"])
def test_a_mark_that_is_none_of_ours_is_replaced(clock, mark):
    street = Street(clock)
    assert b"set-cookie" in dict(street.ask("/", cookie=f"{COOKIE}={mark}")["headers"])
    assert street.mark != mark


def test_buckets_forget_the_oldest_address_and_no_other(clock):
    buckets = Buckets(clock, 1.0, 1.0)
    keys = [str(i) for i in range(5000)]
    assert all(buckets.take(key) for key in keys)
    assert not any(buckets.take(key) for key in keys[-4096:])


# the terms of the cell file


def test_without_a_password_it_is_loopback_only(clock):
    assert Terms().guard("127.0.0.1", clock) is None
    with pytest.raises(ServingError, match="not without certificate"):
        Terms().guard("0.0.0.0", clock)  # noqa: S104  it is refused


def test_what_the_cell_file_says_reaches_the_page(tmp_path):
    """Paths count from the cell file's folder, whatever folder the process has."""
    path = tmp_path / "cell.toml"
    section = [
        "[page]",
        'host = "0.0.0.0"',
        "port = 8080",
        'names = ["cell1.plant.lan"]',
        'certificate = "page.crt"',
        'key = "/etc/page.key"',
        'password_file = "password"',
    ]
    path.write_text("\n".join([EXAMPLE.read_text(), *section]))
    resolved = Resolved(load_config(path), str(path), 0.0)
    table = process_table(resolved, save_resolved(resolved, tmp_path))
    (argv,) = (one["argv"] for one in table["processes"] if one["name"] == "page")
    terms = Terms(**json.loads(argv[-1]))
    assert terms.is_guarded
    assert list(terms.names) == ["cell1.plant.lan"]
    files = (terms.certificate, terms.key, terms.password_file)
    assert files == (f"{tmp_path}/page.crt", "/etc/page.key", f"{tmp_path}/password")


def test_files_that_are_no_pem_are_told_with_the_remedy(file, clock, tmp_path):
    other = tmp_path / "other"
    other.write_text("no key")
    for name in (str(other), str(tmp_path / "none")):
        with pytest.raises(ServingError, match="must be PEM files"):
            Terms((), name, name, str(file)).guard("127.0.0.1", clock)


def test_no_command_goes_to_the_link_but_by_the_visitor():
    """There it is checked; a tab that asked the link itself would be an open door."""
    sources = Path(doors.__file__).parents[1].glob("*.py")
    assert [one.name for one in sources if "link.command(" in one.read_text()] == ["visitor.py"]
