"""Who presses enter for each step that `vgrd teach` tells has a calibration in use; pipes drive it by lines."""

import asyncio
import json
import threading
from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import pytest

from tests.cell.control.test_wizard import MOST_STEPS, ObedientCell
from vgrd.calibration.solve import calibrate_system
from vgrd.commands.wizard import teach
from vgrd.errors import ControlError, DaemonUnreachable, VgrdError
from vgrd.solving.advisor import answer_line
from vgrd.solving.shelf import active_calibration
from vgrd.store.sessions import load_session

REPLY_S = 120.0  # longer than the busiest machine takes


class Daemon:
    """The control operations over an obedient cell: whatever is recorded, the operator did as the step said."""

    def __init__(self, cell: ObedientCell) -> None:
        self.cell, self.step, self.asked = cell, {}, []
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()
        self.advising = asyncio.run_coroutine_threadsafe(cell.advisor.run(), self.loop)
        guarded = cell.versions.guarded
        self.guarded = {
            "record.start": guarded(lambda a: cell.teaching.start(a["plan"], "one"), "plan"),
            "record.stop": guarded(lambda _: cell.teaching.stop()),
            "spin": guarded(lambda _: self._obey("spin")),
            "look": guarded(lambda _: self._obey("look")),
            "touch": guarded(lambda _: self._obey("touch"), "target"),
            "verify": guarded(lambda _: self._obey("verify"), "target"),
            "undo": guarded(lambda _: self._obey("mend"), "sample"),
            "activate": guarded(self._activate, "calibration"),
        }

    def call(self, op: str, *, timeout_s: float, **given: Any) -> Mapping[str, Any]:
        del timeout_s
        self.asked.append((op, given))
        try:
            return asyncio.run_coroutine_threadsafe(self._performed(op, given), self.loop).result(
                REPLY_S
            )
        except VgrdError as err:
            raise ControlError(str(err), error=type(err).__name__) from err

    async def _performed(self, op: str, given: Mapping[str, Any]) -> Mapping[str, Any]:
        if op == "solve":
            recording = load_session(self.cell.teaching.last_session).recording
            name = self.cell.store.save(calibrate_system(recording))
            return {"calibration": name}
        if op != "teaching":
            return await self.guarded[op].perform(given)
        state = await self.cell.state()
        self.step = state["step"]
        return json.loads(json.dumps({"version": self.cell.versions.now, **state}))

    async def _obey(self, kind: str) -> Mapping[str, Any]:
        await self.cell.obey({**self.step, "kind": kind})
        return {}

    async def _activate(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        self.cell.store.activate(given["calibration"])
        self.cell.serving.calibration = SimpleNamespace(id=given["calibration"])
        return {}

    def end(self) -> None:
        asyncio.run_coroutine_threadsafe(self._closed(), self.loop).result(REPLY_S)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()

    async def _closed(self) -> None:
        if self.cell.teaching.recorder.writer is not None:
            await self.cell.teaching.stop()
        await self.cell.advisor.close()
        self.advising.cancel()


@pytest.fixture
def daemon(tmp_path, monkeypatch) -> Iterator[Daemon]:
    cell = ObedientCell(tmp_path)

    async def at_once(request: object) -> dict[str, object]:
        return json.loads(answer_line(json.dumps(request)))

    monkeypatch.setattr(cell.advisor, "_exchanged", at_once)
    daemon = Daemon(cell)
    monkeypatch.setattr(teach, "client_of", lambda *_: daemon)
    yield daemon
    daemon.end()


class Operator:
    """Standard input: types what `answer` says for the step that was told last."""

    def __init__(self, daemon: Daemon, steps: int = MOST_STEPS) -> None:
        self.daemon, self.left, self.kinds = daemon, steps, []

    def isatty(self) -> bool:
        return False

    def readline(self) -> str:
        self.left -= 1
        kind = self.daemon.step["kind"]
        if self.left < 0 or kind == "done":
            return ""
        self.kinds.append(kind)
        return "u\n" if kind == "mend" else "\n"


def test_enter_for_each_step_ends_with_a_calibration_in_use(vgrd, daemon, monkeypatch):
    operator = Operator(daemon)
    monkeypatch.setattr("sys.stdin", operator)
    done = vgrd("teach", "--socket", "unused")
    assert done.code == 0, done.err
    kinds = [kind for kind in operator.kinds if kind != "mend"]
    assert kinds[0] == "start"
    assert kinds[1:11] == ["spin"] * 4 + ["touch"] * 6
    assert kinds[-2:] == ["solve", "activate"]
    lines = done.out.splitlines()
    assert [one for one in lines if one.startswith("not done")] == []
    shown = [one.split(" ")[0].rstrip(":").lower() for one in lines if " | " in one]
    assert shown == [*operator.kinds, "done"]  # a line per state; the daemon logs here too
    changing = [given for op, given in daemon.asked if op not in ("teaching", "solve")]
    assert all("version" in given for given in changing)
    assert "predicted 95 % error, mm: P1 " in done.out
    assert active_calibration(daemon.cell.store) == daemon.cell.serving.calibration.id


def test_a_wizard_that_was_left_goes_on_where_it_was(vgrd, daemon, monkeypatch):
    monkeypatch.setattr("sys.stdin", Operator(daemon, steps=3))
    left = vgrd("teach", "--socket", "unused").out.splitlines()[-1]
    monkeypatch.setattr("sys.stdin", Operator(daemon, steps=0))
    found = vgrd("teach", "--plain", "--socket", "unused").out.splitlines()[0]
    assert left.split(" | ")[0] == found.split(" | ")[0]
    assert "2 of" in found


def test_what_somebody_else_changed_meanwhile_is_not_done_but_told(daemon):
    state = daemon.call("teaching", timeout_s=REPLY_S)
    daemon.call("record.start", timeout_s=REPLY_S, plan="joint")
    (told,) = teach._done(daemon, " ", state, "joint")
    assert told.startswith("not done: ")
    assert "somebody did something else" in told


def test_a_daemon_that_is_gone_ends_it_with_its_code(vgrd, daemon, monkeypatch):
    def gone(*_: object, **__: object) -> None:
        raise DaemonUnreachable("no answer")

    monkeypatch.setattr(daemon, "call", gone)
    assert vgrd("teach", "--plain", "--socket", "unused").code == DaemonUnreachable.exit_code
