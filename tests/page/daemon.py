"""A daemon of paper for the page: the real control server, replies set by hand, and a switch that freezes it."""

import asyncio
import base64
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from tests.reporting.sessions import recorded
from vgrd.cell.control.server import ControlServer, Operation
from vgrd.errors import ControlError, StaleVersion
from vgrd.geometry import Pose
from vgrd.solving.session import solve_session

JPEG = cv2.imencode(".jpg", np.full((30, 40), 128, np.uint8))[1].tobytes()
FILM_S = 0.2  # from one picture to the next
STEP = {
    "kind": "touch",
    "words": "put the tip on P2, the wrist as it works",
    "target": "P2",
    "tilted": False,
    "sample": None,
    "done": 1,
    "of": 2,
    "flange_mm": [1.0, 2.0, 3.0],
    "rotvec_deg": [180.0, 0.0, 0.0],
    "no_pose": "",
    "u95_before_mm": 0.5,
    "u95_after_mm": 0.4,
}
_COMMANDS = (
    "touch",
    "verify",
    "spin",
    "look",
    "undo",
    "retag",
    "point",
    "record.start",
    "record.stop",
)
_COMMANDS += ("activate", "rollback")
_ARGUMENTS = (
    "version",
    "target",
    "sample",
    "plan",
    "session",
    "calibration",
    "active",
    "kind",
    "by",
)


def registers() -> dict[str, Any]:
    return {
        "age_s": 0.01,
        "state": "READY",
        "valid": False,
        "status": 0,
        "name": "IDLE",
        "words": "nothing asked",
        "remedy": "nothing",
        "position_mm": None,
        "rotvec_deg": None,
        "u95_mm": None,
        "age_ms": None,
        "point": 0,
        "asked_s_ago": 14.0,
        "read_s_ago": None,
    }


def teaching() -> dict[str, Any]:
    return {
        "version": "v1",
        "session": {"name": "one", "plan": "joint", "folder": "/x"},
        "step": dict(STEP),
        "have": {"touch": 1},
        "missing": {},
        "harvested": {},
        "warning": "",
        "trouble": "",
        "computing": False,
        "unknown": "",
        "odd": [],
        "questions": {},
        "tolerance_mm": 1.0,
        "targets": [
            {"name": "P1", "touches": 1, "u95_mm": 0.4},
            {"name": "P2", "touches": 0, "u95_mm": None},
        ],
        "trend": [{"sample": 3, "minutes": 1.0, "u95_mm": 0.6}],
        "samples": [
            {
                "sample": 3,
                "kind": "touch",
                "target": "P1",
                "harvested": False,
                "words": "touch P1",
                "remark": "",
                "question": "",
            }
        ],
        "touches": [{"name": "touch 1 (P1)", "off_mm": 0.1, "left_out_mm": 0.2, "reason": ""}],
        "clock": {"minutes": 1.0, "by_step": {"touch": 1.0}, "elapsed_s": 60.0},
    }


def full(folder: Path) -> dict[str, Any]:
    """Replies of a cell that was taught and asked for a while; the result is one that was solved."""
    session = recorded(folder)
    result = solve_session(session, folder, tolerance_mm=2.0)
    answer = {
        "unix_s": 1.7e9,
        "target": "P1",
        "name": "OK",
        "u95_mm": 0.3,
        "age_ms": 200,
        "latency_ms": 310,
        "words": "the expected coordinate is valid",
    }
    hours = [{"unix_s": 1.7e9 + 3600 * i, "camera_mm": 0.01 * i, "misfit": 1.0} for i in range(48)]
    fault = {"unix_s": 1.7e9, "status": "CAMERA_OFFLINE", "words": "cable", "lasted_s": 12.5}
    row = {"session": "one", "made": "today", "verdict": "good", "u95_mm": 0.3}
    rows = [{**row, "id": f"cal-00000{i}", "active": i == 2, "made_unix_s": 1.7e9} for i in (1, 2)]
    where = Pose.from_rotvec([np.pi, 0, 0], [0, 0, 500]).matrix().tolist()
    return {
        "result": {"session": "one", "result": result},
        "answers": {"answers": [answer] * 5, "counts": {"OK": 5, "TAG_B_NOT_FOUND": 2}},
        "trials": result["verification"],
        "diary": {"hours": hours, "faults": [fault]},
        "calibrations": {"active": "cal-000002", "calibrations": rows, "activations": []},
        "sessions": {
            "sessions": [
                {"name": "one", "plan": "joint", "begun": "today", "samples": {"touch": 6}}
            ]
        },
        "scene": {
            "known": "session",
            "flange": where,
            "camera": where,
            "tag_a": where,
            "tag_b": where,
            "axis": where,
            "tip_in_wrist": [0.0, 0.0, 120.0],
            "targets": {"P1": [50.0, 20.0, 300.0]},
            "tag_mm": {"a": 30.0, "b": 40.0},
        },
    }


class PaperDaemon:
    """Answers at RUNTIME_DIR/control.sock while it is open; `given` holds the commands that it took.

    refused: words by operation; held: operations that are not answered now; films: pictures follow each other.
    """

    def __init__(self, runtime_dir: Path) -> None:
        self.replies: dict[str, Any] = {
            "registers": registers(),
            "teaching": teaching(),
            "status": {
                "robot": "ok",
                "camera": "ok",
                "processes": {"cell": "running"},
                "targets": ["P1", "P2"],
            },
            "answers": {"answers": [], "counts": {"OK": 3}},
            "calibrations": {"active": None, "calibrations": [], "activations": []},
            "sessions": {"sessions": []},
            "result": {"session": None, "result": None},
            "diary": {"hours": [], "faults": []},
            "trials": {},
            "scene": {"known": "", "flange": None, "tip_in_wrist": None, "tag_mm": {}},
        }
        self.frame, self._jpeg, self.taken_unix_s = 1, JPEG, time.time()
        self.films, self.period_s = False, FILM_S
        self.refused: dict[str, str] = {}
        self.held: set[str] = set()
        self._gate_since_s: float | None = None
        self.given: list[tuple[str, Mapping[str, Any]]] = []
        self.asked: list[str] = []
        self._frozen = threading.Event()
        names = {name: Operation(self._reply(name)) for name in self.replies}
        names["picture"] = Operation(self._picture, ("after", "wait_s", "width_px"))
        names["report"] = Operation(self._report, ("session",))
        for op in _COMMANDS:
            names[op] = Operation(self._command(op), _ARGUMENTS)
        self._server = ControlServer(runtime_dir / "control.sock", names)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        while not self._server.path.exists():
            threading.Event().wait(0.005)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop)
        self._thread.join()

    def freeze(self) -> None:
        """Answer nothing from now on; connections stay open."""
        self._frozen.set()

    def thaw(self) -> None:
        """Go on."""
        self._frozen.clear()

    def age_gate(self, *, on: bool) -> None:
        """Let the gate's report grow old, as if the gate stood still since now."""
        self._gate_since_s = time.monotonic() if on else None

    def show(self, jpeg: bytes) -> None:
        """Another picture, taken now."""
        self._jpeg, self.taken_unix_s = jpeg, time.time()
        self.frame += 1

    def _run(self) -> None:
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        self._task = asyncio.current_task()
        await self._server.serve()

    def _stop(self) -> None:
        self._frozen.clear()
        self.held.clear()
        assert self._task is not None
        self._task.cancel()

    async def _thawed(self, op: str) -> None:
        while self._frozen.is_set() or op in self.held:  # noqa: ASYNC110  another thread sets it
            await asyncio.sleep(0.01)
        if op in self.refused:
            raise ControlError(self.refused[op])

    def _reply(self, name: str) -> Any:
        async def told(_: Mapping[str, Any]) -> Mapping[str, Any]:
            self.asked.append(name)
            await self._thawed(name)
            reply = self.replies[name]
            if name == "registers" and self._gate_since_s is not None:
                return {**reply, "age_s": time.monotonic() - self._gate_since_s}
            return reply

        return told

    async def _report(self, arguments: Mapping[str, Any]) -> Mapping[str, Any]:
        if arguments.get("session") == "missing":
            raise ControlError("no such session")
        return {"session": "one", "html": "<h1>Calibration report</h1>"}

    def _command(self, op: str) -> Any:
        async def done(arguments: Mapping[str, Any]) -> Mapping[str, Any]:
            await self._thawed(op)
            if arguments.get("version") != self.replies["teaching"]["version"]:
                raise StaleVersion("not done: somebody did something else since this was shown")
            if op == "look":
                raise ControlError("tag A is not in the picture")
            self.given.append((op, dict(arguments)))
            return {"sample": 7}

        return done

    async def _picture(self, arguments: Mapping[str, Any]) -> Mapping[str, Any]:
        self.asked.append("picture")
        await self._thawed("picture")
        if self.films and time.time() - self.taken_unix_s > FILM_S:
            self.show(self._jpeg)
        end_s = time.monotonic() + 0.05
        while arguments.get("after") == self.frame and time.monotonic() < end_s:  # noqa: ASYNC110
            await asyncio.sleep(0.005)
        return {
            "frame": self.frame,
            "taken_unix_s": self.taken_unix_s,
            "width_px": 40,
            "height_px": 30,
            "full_px": [400, 300],
            "jpeg": base64.b64encode(self._jpeg).decode(),
            "robot_at_rest": True,
            "age_s": time.time() - self.taken_unix_s,
            "period_s": self.period_s,
            "tags": {
                "a": {
                    "wanted": "36h11 id 0",
                    "corners": [[1, 1], [9, 1], [9, 9], [1, 9]],
                    "fit_px": 0.1,
                    "side_px": 80,
                }
            },
        }
